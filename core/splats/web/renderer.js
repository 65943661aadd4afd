"use strict";
// Draws Gaussians with WebGL 2 as cvdgs' rasteriser does: EWA splatting with its constants, sorted by planar depth,
// blended in half floats. Two sets of colours are mixed while drawing; what an observer sees is made of the picture.

const SPLAT_VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
uniform sampler2D means, colorsA, colorsB;   // colours are half floats, those of degree 0
uniform usampler2D shapes, restA, restB;
uniform mat3 rotation;                       // world to camera, OpenCV axes
uniform vec3 translation, center;
uniform vec4 lens;                           // fx, fy, cx, cy in pixels
uniform vec4 bounds;                         // of x / z and y / z, within which the perspective is linearised
uniform vec2 size;                           // of the picture, pixels
uniform vec2 scaleCode;                      // log scale = x + y * code
uniform vec2 restCodeA, restCodeB;
uniform ivec2 degrees;
uniform vec2 amounts;                        // of B among the colours left and right of the wipe
uniform int width;                           // of the textures, texels
in uint index;
in vec2 corner;
out vec2 offset;                             // in standard deviations
flat out vec3 left, right;
flat out float opacity;

const float LOW_PASS = 0.3;                  // square pixels; as in gaussians.py
const float ALPHA_MIN = 1.0 / 255.0;

uint codeAt(usampler2D codes, int first, int i) {
  int texel = first + i / 16;
  uvec4 four = texelFetch(codes, ivec2(texel % width, texel / width), 0);
  return (four[(i / 4) % 4] >> uint(8 * (i % 4))) & 255u;
}

vec3 termOf(usampler2D codes, vec2 code, int first, int k) {
  vec3 q = vec3(codeAt(codes, first, 3 * k), codeAt(codes, first, 3 * k + 1),
                codeAt(codes, first, 3 * k + 2));
  return code.x + code.y * q;
}

vec3 harmonics(usampler2D codes, vec2 code, int degree, int i, vec3 d) {
  if (degree < 1) return vec3(0.0);
  int first = i * (degree == 1 ? 1 : degree == 2 ? 2 : 3);  // texels of 16 codes
  float x = d.x, y = d.y, z = d.z, xx = x * x, yy = y * y, zz = z * z;
  const float a = 0.4886025119029199;
  vec3 sum = -a * y * termOf(codes, code, first, 0) + a * z * termOf(codes, code, first, 1)
    - a * x * termOf(codes, code, first, 2);
  if (degree < 2) return sum;
  sum += 1.0925484305920792 * (x * y * termOf(codes, code, first, 3) - y * z * termOf(codes, code, first, 4)
      - x * z * termOf(codes, code, first, 6))
    + 0.31539156525252005 * (2.0 * zz - xx - yy) * termOf(codes, code, first, 5)
    + 0.5462742152960396 * (xx - yy) * termOf(codes, code, first, 7);
  if (degree < 3) return sum;
  return sum - 0.5900435899266435 * (y * (3.0 * xx - yy) * termOf(codes, code, first, 8)
      + x * (xx - 3.0 * yy) * termOf(codes, code, first, 14))
    + 2.890611442640554 * x * y * z * termOf(codes, code, first, 9)
    - 0.4570457994644658 * (4.0 * zz - xx - yy) * (y * termOf(codes, code, first, 10)
      + x * termOf(codes, code, first, 12))
    + 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * termOf(codes, code, first, 11)
    + 1.445305721320277 * z * (xx - yy) * termOf(codes, code, first, 13);
}

mat3 rotationOf(vec4 q) {  // wxyz
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
              2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
              2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside
  int i = int(index);
  ivec2 place = ivec2(i % width, i / width);
  vec3 mean = texelFetch(means, place, 0).xyz;
  uvec4 code = texelFetch(shapes, place, 0);
  vec4 q = normalize(vec4(ivec4(code.x << 16u, code.x, code.y << 16u, code.y) >> 16));
  vec3 deviations = exp(scaleCode.x + scaleCode.y * vec3(code.z & 65535u, code.z >> 16u, code.w & 65535u));
  opacity = float(code.w >> 16u) / 65535.0;
  if (opacity <= ALPHA_MIN) return;

  vec3 view = rotation * mean + translation;
  vec2 slope = clamp(view.xy / view.z, bounds.xz, bounds.yw);
  vec2 f = lens.xy / view.z;
  mat3 axes = rotation * rotationOf(q);
  vec3 row0 = f.x * (vec3(axes[0].x, axes[1].x, axes[2].x) - slope.x * vec3(axes[0].z, axes[1].z, axes[2].z));
  vec3 row1 = f.y * (vec3(axes[0].y, axes[1].y, axes[2].y) - slope.y * vec3(axes[0].z, axes[1].z, axes[2].z));
  row0 *= deviations;
  row1 *= deviations;
  float a = dot(row0, row0) + LOW_PASS, b = dot(row0, row1), d = dot(row1, row1) + LOW_PASS;
  float middle = 0.5 * (a + d), spread = length(vec2(0.5 * (a - d), b));
  float major = middle + spread, minor = max((a * d - b * b) / major, 1e-6);
  vec2 axis = spread < 1e-6 * middle ? vec2(1.0, 0.0)
    : normalize(a > d ? vec2(spread + 0.5 * (a - d), b) : vec2(b, spread + 0.5 * (d - a)));

  float reach = sqrt(2.0 * log(opacity / ALPHA_MIN));
  offset = corner * reach;
  vec2 pixel = lens.xy * (view.xy / view.z) + lens.zw
    + offset.x * sqrt(major) * axis + offset.y * sqrt(minor) * vec2(-axis.y, axis.x);
  gl_Position = vec4(2.0 * pixel / size - 1.0, 0.0, 1.0);
  gl_Position.y = -gl_Position.y;

  vec3 direction = normalize(mean - center);
  vec3 colorA = max(texelFetch(colorsA, place, 0).rgb + harmonics(restA, restCodeA, degrees.x, i, direction), 0.0);
  vec3 colorB = max(texelFetch(colorsB, place, 0).rgb + harmonics(restB, restCodeB, degrees.y, i, direction), 0.0);
  left = mix(colorA, colorB, amounts.x);
  right = mix(colorA, colorB, amounts.y);
}`;

const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
uniform float wipe;  // pixels from the left
in vec2 offset;
flat in vec3 left, right;
flat in float opacity;
out vec4 result;
void main() {
  float alpha = min(opacity * exp(-0.5 * dot(offset, offset)), 0.999);
  if (alpha < 1.0 / 255.0) discard;
  result = vec4(alpha * (gl_FragCoord.x < wipe ? left : right), alpha);
}`;

const PICTURE_VERTEX = `#version 300 es
in vec2 corner;
void main() { gl_Position = vec4(corner, 0.0, 1.0); }`;

// What is seen: over the background, then through the observer's matrix in linear light.
const PICTURE_FRAGMENT = `#version 300 es
precision highp float;
uniform highp sampler2D picture;
uniform vec3 background;
uniform mat3 above, below;
uniform vec3 separator;  // colours behind this plane take the matrix "below"
uniform bool simulates;
out vec4 result;
vec3 decode(vec3 c) { return mix(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, lessThanEqual(c, vec3(0.04045))); }
vec3 encode(vec3 c) {
  return mix(1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, 12.92 * c, lessThanEqual(c, vec3(0.0031308)));
}
void main() {
  vec4 drawn = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
  vec3 color = clamp(drawn.rgb + (1.0 - drawn.a) * background, 0.0, 1.0);
  if (simulates) {
    vec3 light = decode(color);
    light = dot(separator, light) < 0.0 ? below * light : above * light;
    color = encode(clamp(light, 0.0, 1.0));
  }
  result = vec4(color, 1.0);
}`;

const TEXTURES = ["means", "shapes", "colorsA", "colorsB", "restA", "restB"];
const FIELD_OF_VIEW_MARGIN = 0.3;
const TOO_LARGE = "The scene is too large for this graphics card.";

class Renderer {
  // Throws where the browser has no WebGL 2 or the scene does not fit.
  constructor(canvas, scene) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error("This browser has no WebGL 2.");
    this.canvas = canvas;
    this.gl = gl;
    this.scene = scene;
    const canBlendHalves = gl.getExtension("EXT_color_buffer_float") || gl.getExtension("EXT_color_buffer_half_float");
    this.targetFormat = canBlendHalves ? [gl.RGBA16F, gl.HALF_FLOAT] : [gl.RGBA8, gl.UNSIGNED_BYTE];
    this.width = Math.min(gl.getParameter(gl.MAX_TEXTURE_SIZE), 4096);
    this.splats = this.program(SPLAT_VERTEX, SPLAT_FRAGMENT);
    this.picture = this.program(PICTURE_VERTEX, PICTURE_FRAGMENT);
    const texture = (data, ...format) => this.texture(data, scene.count, ...format);
    this.textures = {
      means: texture(scene.means, 3, gl.RGB32F, gl.RGB, gl.FLOAT),
      shapes: texture(scene.shapes, 4, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT),
    };
    this.colors = scene.layers.map((layer) => ({
      colors: texture(layer.colors, 3, gl.RGB16F, gl.RGB, gl.HALF_FLOAT),
      rest: this.texture(layer.rest, Math.max(layer.rest.length / 4, 1), 4, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT),
      degree: layer.degree,
      code: layer.restCode,
    }));
    this.quad = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    this.order = gl.createBuffer();
    this.drawn = 0;
    this.target = gl.createTexture();
    this.frame = gl.createFramebuffer();
    this.size = [0, 0];
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "corner");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error(`The graphics driver refuses the shaders. ${gl.getProgramInfoLog(program)}`);
    const uniforms = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name } = gl.getActiveUniform(program, i);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms, index: gl.getAttribLocation(program, "index") };
  }

  texture(data, count, parts, internal, format, type) {
    const gl = this.gl, rows = Math.max(Math.ceil(count / this.width), 1);
    if (rows > gl.getParameter(gl.MAX_TEXTURE_SIZE)) throw new Error(TOO_LARGE);
    let padded = data;
    if (data.length < rows * this.width * parts) {
      padded = new data.constructor(rows * this.width * parts);
      padded.set(data);
    }
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, this.width, rows, 0, format, type, padded);
    if (gl.getError() === gl.OUT_OF_MEMORY) throw new Error(TOO_LARGE);
    this.unfiltered();
    return texture;
  }

  unfiltered() {
    const gl = this.gl;
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }

  setOrder(order) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.bufferData(gl.ARRAY_BUFFER, order, gl.DYNAMIC_DRAW);
    this.drawn = order.length;
  }

  resize(width, height) {
    if (width === this.size[0] && height === this.size[1]) return;
    const gl = this.gl;
    this.size = [width, height];
    this.canvas.width = width;
    this.canvas.height = height;
    gl.bindTexture(gl.TEXTURE_2D, this.target);
    gl.texImage2D(gl.TEXTURE_2D, 0, this.targetFormat[0], width, height, 0, gl.RGBA, this.targetFormat[1], null);
    this.unfiltered();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.target, 0);
  }

  // camera: rotation (9, row-major), translation, width, height, fx, fy, cx, cy. look: layer, amounts, wipe (0 to 1, or
  // null), simulation (above, below, separator) or null.
  draw(camera, look) {
    const gl = this.gl, { width, height, fx, fy, cx, cy, rotation: r, translation: t } = camera;
    this.resize(width, height);
    gl.viewport(0, 0, width, height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    let { program, uniforms: u, index } = this.splats;
    gl.useProgram(program);
    const first = this.colors[0], second = this.colors[look.layer];
    const bound = { ...this.textures, colorsA: first.colors, colorsB: second.colors, restA: first.rest, restB: second.rest };
    TEXTURES.forEach((name, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, bound[name]);
      gl.uniform1i(u[name], unit);
    });
    gl.uniformMatrix3fv(u.rotation, true, r);
    gl.uniform3fv(u.translation, t);
    gl.uniform3fv(u.center, [0, 1, 2].map((i) => -(r[i] * t[0] + r[3 + i] * t[1] + r[6 + i] * t[2])));
    gl.uniform4f(u.lens, fx, fy, cx, cy);
    const [sideX, sideY] = [(FIELD_OF_VIEW_MARGIN * 0.5 * width) / fx, (FIELD_OF_VIEW_MARGIN * 0.5 * height) / fy];
    gl.uniform4f(u.bounds, -cx / fx - sideX, (width - cx) / fx + sideX, -cy / fy - sideY, (height - cy) / fy + sideY);
    gl.uniform2f(u.size, width, height);
    gl.uniform2fv(u.scaleCode, this.scene.scaleCode);
    gl.uniform2fv(u.restCodeA, first.code);
    gl.uniform2fv(u.restCodeB, second.code);
    gl.uniform2i(u.degrees, first.degree, second.degree);
    gl.uniform2fv(u.amounts, look.amounts);
    gl.uniform1i(u.width, this.width);
    gl.uniform1f(u.wipe, look.wipe === null ? -1 : look.wipe * width);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribIPointer(index, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(index, 1);
    this.corners();
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.drawn);
    gl.disableVertexAttribArray(index);
    gl.disable(gl.BLEND);

    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    ({ program, uniforms: u } = this.picture);
    gl.useProgram(program);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.target);
    gl.uniform1i(u.picture, 0);
    gl.uniform3fv(u.background, this.scene.background);
    gl.uniform1i(u.simulates, look.simulation ? 1 : 0);
    if (look.simulation) {
      gl.uniformMatrix3fv(u.above, true, look.simulation.above);
      gl.uniformMatrix3fv(u.below, true, look.simulation.below);
      gl.uniform3fv(u.separator, look.simulation.separator);
    }
    this.corners();
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  get isLost() { return this.gl.isContextLost(); }

  // Wait until what was asked for is drawn.
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  corners() {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    gl.vertexAttribDivisor(0, 0);
  }
}
