#!/bin/sh
# Looks for the system libraries that the bpy wheel loads. Installs what is missing where that is possible without asking
# (root on a Debian-like system), else says what to type. Never fails on systems that it does not know.
# With --check it only prints the packages that are missing. OpenGL off the screen, which EEVEE needs, and from Blender
# 5.2 on the compositor, is installed along with them and not asked for.
set -eu

[ "$(uname -s)" = Linux ] || exit 0
command -v ldconfig >/dev/null 2>&1 || PATH="$PATH:/sbin:/usr/sbin"
command -v ldconfig >/dev/null 2>&1 || exit 0

missing=""
for pair in libX11.so.6=libx11-6 libXrender.so.1=libxrender1 libXfixes.so.3=libxfixes3 libXi.so.6=libxi6 \
            libxkbcommon.so.0=libxkbcommon0 libXext.so.6=libxext6 libSM.so.6=libsm6 libICE.so.6=libice6 libGL.so.1=libgl1; do
    ldconfig -p | grep -q "${pair%%=*}" || missing="$missing ${pair##*=}"
done
if [ "${1:-}" = --check ]; then
    echo $missing
    exit 0
fi
wanted="$missing"
ldconfig -p | grep -q libEGL.so.1 || wanted="$missing libegl1"
[ -n "$wanted" ] || exit 0

if ! command -v apt-get >/dev/null 2>&1; then
    [ -n "$missing" ] || exit 0
    echo "Blender's module needs system libraries that are missing; Debian calls them:$missing" >&2
    exit 0
fi
if [ "$(id -u)" != 0 ]; then
    [ -n "$missing" ] || exit 0
    echo "Blender's module needs system libraries that are missing. Type:" >&2
    echo "    sudo apt-get install$missing" >&2
    echo "or do without Blender's module: make venv BLENDER=no, then run.py with --no-blend." >&2
    exit 1
fi
echo "installing system libraries for Blender's module:$wanted"
apt-get update -qq
DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends $wanted >/dev/null
