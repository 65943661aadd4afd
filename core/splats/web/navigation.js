"use strict";
// Where the page's camera is: on a sphere around a point, upright; and what hands, mice and keys do to it.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (a, s, b) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const unit = (a) => { const length = Math.hypot(...a) || 1; return a.map((x) => x / length); };
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

const STEEPEST = 1.5;  // radians from level

class Orbit {
  // up: of the scene; radius: of the scene, from which the limits of the distance follow.
  constructor(up, radius) {
    this.up = unit(up);
    this.nearest = 0.02 * radius;
    this.farthest = 20 * radius;
    const other = Math.abs(this.up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
    this.east = unit(cross(other, this.up));
    this.north = cross(this.up, this.east);
    this.target = [0, 0, 0];
    this.distance = 2 * radius;
    this.yaw = 0;
    this.pitch = 0.3;
  }

  // Stand at `eye` and look along `forward`, at a point that far away.
  stand(eye, forward, distance) {
    this.distance = clamp(distance, this.nearest, this.farthest);
    this.target = along(eye, this.distance, forward);
    this.pitch = clamp(Math.asin(clamp(-dot(forward, this.up), -1, 1)), -STEEPEST, STEEPEST);
    this.yaw = Math.atan2(-dot(forward, this.north), -dot(forward, this.east));
  }

  // Rows of the rotation from world to camera (x right, y down, z forward), and the eye.
  axes() {
    const level = along(this.east.map((x) => x * Math.cos(this.yaw)), Math.sin(this.yaw), this.north);
    const back = along(level.map((x) => x * Math.cos(this.pitch)), Math.sin(this.pitch), this.up);
    const forward = back.map((x) => -x);
    const right = unit(cross(forward, this.up));
    return { right, down: cross(forward, right), forward, eye: along(this.target, this.distance, back) };
  }

  pose() {
    const { right, down, forward, eye } = this.axes();
    return { rotation: [...right, ...down, ...forward], translation: [-dot(right, eye), -dot(down, eye), -dot(forward, eye)] };
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = clamp(this.pitch + pitch, -STEEPEST, STEEPEST);
  }

  // x, y: in units of the distance, to the right and down.
  slide(x, y) {
    const { right, down } = this.axes();
    this.target = along(along(this.target, x * this.distance, right), y * this.distance, down);
  }

  approach(factor) {
    this.distance = clamp(this.distance * factor, this.nearest, this.farthest);
  }
}

// Fingers, mouse and wheel on `canvas` move `orbit`; `changed` is called after each move.
function listenToHands(canvas, orbit, changed) {
  const pointers = new Map();
  const size = () => Math.min(canvas.clientWidth, canvas.clientHeight) || 1;
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, length: Math.hypot(a.x - b.x, a.y - b.y) || 1 };
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last) return;
    const before = pointers.size === 2 ? spread() : null;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const x = (event.clientX - last.x) / size(), y = (event.clientY - last.y) / size();
    if (before) {
      const after = spread();
      orbit.approach(before.length / after.length);
      orbit.slide((before.x - after.x) / size(), (before.y - after.y) / size());
    } else if (pointers.size === 1) {
      if (event.buttons & 6 || event.shiftKey) orbit.slide(-x, -y);
      else orbit.turn(-4 * x, 4 * y);
    }
    changed();
  });
  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    orbit.approach(Math.exp(clamp(event.deltaY * (event.deltaMode ? 16 : 1), -200, 200) * 0.0015));
    changed();
  }, { passive: false });
}

// What a key does to `orbit`; false where it does nothing.
function pressKey(orbit, event) {
  const step = 0.08;
  const moves = {
    ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
  }[event.key];
  if (moves) {
    if (event.shiftKey) orbit.slide(step * moves[0], step * moves[1]);
    else orbit.turn(step * moves[0], -step * moves[1]);
  } else if (event.key === "+" || event.key === "=") orbit.approach(1 - step);
  else if (event.key === "-") orbit.approach(1 / (1 - step));
  else return false;
  return true;
}
