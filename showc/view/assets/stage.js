// Draws the fleet, the ground and the fence with WebGL 2.

const DRONE_VERTEX = `#version 300 es
in vec3 before, after;
in vec4 colourBefore, colourAfter;
uniform mat4 camera;
uniform vec3 origin, scale;
uniform float share, pixels, mirror, radius, least;
out vec3 colour;
void main() {
  vec3 place = origin + scale * mix(before, after, share);
  place.z *= mirror;
  gl_Position = camera * vec4(place, 1.0);
  // A place that is not known is left out.
  if (min(before.x, after.x) < ${NOWHERE + 1}.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  colour = mix(colourBefore.rgb, colourAfter.rgb, share);
  float light = max(colour.r, max(colour.g, colour.b));
  float size = (0.3 + 1.9 * light) * pixels / gl_Position.w;
  gl_PointSize = clamp(size, mix(3.0, 9.0, light), 110.0);
  if (radius > 0.0) gl_PointSize = clamp(2.0 * radius * pixels / gl_Position.w, least, 250.0);
}`;

const DRONE_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 colour;
uniform float strength;
uniform vec4 outline;
out vec4 shown;
void main() {
  vec2 place = gl_PointCoord * 2.0 - 1.0;
  float square = dot(place, place);
  if (square > 1.0) discard;
  if (outline.b > 0.0) {
    shown = vec4(outline.rgb * mix(outline.a, 1.0, smoothstep(0.6, 0.9, square)), 1.0);
    return;
  }
  float rest = 1.0 - square;
  float halo = rest * rest * rest * 0.55;
  float core = max(0.0, 1.0 - square * 14.0);
  float light = max(colour.r, max(colour.g, colour.b));
  vec3 body = vec3(0.16, 0.18, 0.22) * (1.0 - light) * smoothstep(0.75, 0.35, square);
  vec3 glow = colour * (halo + core) + vec3(0.4) * core * core * light;
  shown = vec4((glow + body) * strength, 1.0);
}`;

const LINE_VERTEX = `#version 300 es
in vec3 place;
in vec4 tint;
uniform mat4 camera;
out vec4 colour;
void main() {
  gl_Position = camera * vec4(place, 1.0);
  colour = tint;
}`;

const LINE_FRAGMENT = `#version 300 es
precision mediump float;
in vec4 colour;
out vec4 shown;
void main() { shown = vec4(colour.rgb * colour.a, 1.0); }`;

// Bands from below to above the horizon, narrow near it; colours vary along them alone,
// which costs software renderers much less than a formula for every pixel.
const SKY_BANDS = 24;
const SKY_VERTEX = `#version 300 es
uniform float level;
out vec3 colour;
void main() {
  float band = float(gl_VertexID / 2) / ${SKY_BANDS}.0 * 2.0 - 1.0;
  float y = clamp(level + 4.0 * band * abs(band), -1.0, 1.0);
  gl_Position = vec4(gl_VertexID % 2 == 0 ? -1.0 : 1.0, y, 0.0, 1.0);
  float above = y - level;
  vec3 horizon = vec3(0.050, 0.070, 0.120);
  colour = above > 0.0
    ? mix(horizon, vec3(0.010, 0.014, 0.030), 1.0 - exp(-3.0 * above))
    : mix(horizon, vec3(0.014, 0.019, 0.032), 1.0 - exp(14.0 * above));
}`;

const SKY_FRAGMENT = `#version 300 es
precision mediump float;
in vec3 colour;
out vec4 shown;
void main() { shown = vec4(colour, 1.0); }`;

// Smooth edges would cost a processor four times the work; a graphics card nothing.
function drawnInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const details = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = details ? gl.getParameter(details.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

// Outlines: colour, and the share of it inside; radius [m], and least size [px].
const TUBE = { tint: [0.155, 0.372, 0.62, 0.19], least: 6 };
// Rings of a great fleet are smaller, or they would hide it.
const HOLLOW = { tint: [0.35, 0.95, 0.75, 0], radius: 0.3, least: show.drones > 200 ? 9 : 13 };
const FILLED = { tint: [0, 0, 0, 0], radius: 0, least: 0 };

class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    const antialias = !drawnInSoftware();
    const gl = canvas.getContext("webgl2", { alpha: false, antialias, depth: false });
    if (!gl) throw new Error("This page needs WebGL 2, which this browser does not offer.");
    this.gl = gl;
    this.drones = this.program(DRONE_VERTEX, DRONE_FRAGMENT);
    this.lines = this.program(LINE_VERTEX, LINE_FRAGMENT);
    this.sky = this.program(SKY_VERTEX, SKY_FRAGMENT);
    this.empty = gl.createVertexArray();
    this.prepareDrones();
    this.trail = null;
    this.show();
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
  }

  // What stands still is drawn anew, and what moves is sent anew.
  show() {
    if (this.ground) this.gl.deleteVertexArray(this.ground.array);
    this.ground = this.lineSet(groundLines());
    this.showTrail(-1);
    this.uploaded = [-1, -1];
  }

  program(vertex, fragment) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    const uniforms = {};
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < count; i++) {
      const { name } = gl.getActiveUniform(program, i);
      uniforms[name] = gl.getUniformLocation(program, name);
    }
    return { program, uniforms };
  }

  attribute(program, name, buffer, size, type, normalised) {
    const gl = this.gl;
    const at = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at, size, type, normalised, 0, 0);
  }

  prepareDrones() {
    const gl = this.gl;
    this.fleet = gl.createVertexArray();
    gl.bindVertexArray(this.fleet);
    this.buffers = [0, 1].map(() => ({ place: gl.createBuffer(), colour: gl.createBuffer() }));
    const { program } = this.drones;
    for (const [k, place, colour] of [[0, "before", "colourBefore"], [1, "after", "colourAfter"]]) {
      this.attribute(program, place, this.buffers[k].place, 3, gl.SHORT, false);
      this.attribute(program, colour, this.buffers[k].colour, 4, gl.UNSIGNED_BYTE, true);
    }
    // The second fleet: places of its own, no colours.
    this.second = gl.createVertexArray();
    gl.bindVertexArray(this.second);
    this.seconds = [gl.createBuffer(), gl.createBuffer()];
    this.attribute(program, "before", this.seconds[0], 3, gl.SHORT, false);
    this.attribute(program, "after", this.seconds[1], 3, gl.SHORT, false);
    gl.bindVertexArray(null);
  }

  // Vertices [x, y, z] and colours [r, g, b, a], two for each line.
  lineSet({ places, tints }) {
    const gl = this.gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    for (const [name, values, size] of [["place", places, 3], ["tint", tints, 4]]) {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(values), gl.STATIC_DRAW);
      this.attribute(this.lines.program, name, buffer, size, gl.FLOAT, false);
    }
    gl.bindVertexArray(null);
    return { array, count: places.length / 3 };
  }

  showTrail(drone) {
    if (this.trail) this.gl.deleteVertexArray(this.trail.array);
    this.trail = null;
    if (drone < 0) return;
    const places = [];
    const tints = [];
    for (let frame = 0; frame + 1 < show.frames; frame++) {
      for (const k of [frame, frame + 1]) {
        const at = (k * show.drones + drone) * 3;
        for (let axis = 0; axis < 3; axis++) places.push(show.origin[axis] + show.scale[axis] * show.places[at + axis]);
        tints.push(0.5, 0.65, 0.9, 0.32);
      }
    }
    this.trail = this.lineSet({ places, tints });
  }

  upload(frame) {
    const gl = this.gl;
    const { drones } = show;
    [frame, Math.min(frame + 1, show.frames - 1)].forEach((wanted, k) => {
      if (this.uploaded[k] === wanted) return;
      this.uploaded[k] = wanted;
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[k].place);
      gl.bufferData(gl.ARRAY_BUFFER, show.places.subarray(wanted * drones * 3, (wanted + 1) * drones * 3), gl.DYNAMIC_DRAW);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[k].colour);
      gl.bufferData(gl.ARRAY_BUFFER, show.colours.subarray(wanted * drones * 4, (wanted + 1) * drones * 4), gl.DYNAMIC_DRAW);
    });
  }

  drawSecond(time, uniforms) {
    const gl = this.gl;
    const { drones, second } = show;
    const [frame, share] = frameAt(time, second);
    [frame, Math.min(frame + 1, second.frames - 1)].forEach((wanted, k) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.seconds[k]);
      gl.bufferData(gl.ARRAY_BUFFER, second.places.subarray(wanted * drones * 3, (wanted + 1) * drones * 3), gl.DYNAMIC_DRAW);
    });
    gl.bindVertexArray(this.second);
    gl.uniform3fv(uniforms.origin, second.origin);
    gl.uniform3fv(uniforms.scale, second.scale);
    gl.uniform1f(uniforms.share, share);
    this.outline(uniforms, HOLLOW);
    gl.drawArrays(gl.POINTS, 0, drones);
    this.outline(uniforms, FILLED);
  }

  outline(uniforms, { tint, radius, least }) {
    this.gl.uniform4fv(uniforms.outline, tint);
    this.gl.uniform1f(uniforms.radius, radius);
    this.gl.uniform1f(uniforms.least, least);
  }

  drawLines(set, matrix) {
    const gl = this.gl;
    gl.useProgram(this.lines.program);
    gl.uniformMatrix4fv(this.lines.uniforms.camera, false, matrix);
    gl.bindVertexArray(set.array);
    gl.drawArrays(gl.LINES, 0, set.count);
  }

  draw(time) {
    const gl = this.gl;
    const { canvas } = this;
    const density = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * density)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    const matrix = viewProjection(width, height);

    gl.disable(gl.BLEND);
    gl.useProgram(this.sky.program);
    gl.uniform1f(this.sky.uniforms.level, Math.min(Math.max(Math.tan(camera.elevation) / Math.tan(FIELD_OF_VIEW / 2), -3), 3));
    gl.bindVertexArray(this.empty);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 2 * SKY_BANDS + 2);
    gl.enable(gl.BLEND);

    if (!display.client) this.drawLines(this.ground, matrix);
    if (this.trail) this.drawLines(this.trail, matrix);

    const [frame, share] = frameAt(time);
    gl.bindVertexArray(this.fleet);
    this.upload(frame);
    const { program, uniforms } = this.drones;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.camera, false, matrix);
    gl.uniform3fv(uniforms.origin, show.origin);
    gl.uniform3fv(uniforms.scale, show.scale);
    gl.uniform1f(uniforms.share, share);
    gl.uniform1f(uniforms.pixels, height / (2 * Math.tan(FIELD_OF_VIEW / 2)));
    if (show.origin[2] >= -1 && camera.elevation > 0.02 && show.drones <= 400) {
      gl.uniform1f(uniforms.mirror, -1);
      gl.uniform1f(uniforms.strength, 0.10);
      gl.drawArrays(gl.POINTS, 0, show.drones);
    }
    gl.uniform1f(uniforms.mirror, 1);
    gl.uniform1f(uniforms.strength, 1);
    gl.drawArrays(gl.POINTS, 0, show.drones);
    const { tube } = show.segments[segmentAt(time)] ?? {};
    if (display.tubes && tube && !display.client) {
      this.outline(uniforms, { ...TUBE, radius: tube });
      gl.drawArrays(gl.POINTS, 0, show.drones);
      this.outline(uniforms, FILLED);
    }
    if (secondShown()) this.drawSecond(time, uniforms);
    gl.bindVertexArray(null);
    return matrix;
  }
}

// Grid on the ground, pads, fence with its walls, and an arrow to the north.
function groundLines() {
  const places = [];
  const tints = [];
  const line = (a, b, tint, tintAfter = tint) => {
    places.push(...a, ...b);
    tints.push(...tint, ...tintAfter);
  };
  const [low, high] = show.ground;
  const middle = [0, 1].map((k) => (low[k] + high[k]) / 2);
  const reach = Math.max(high[0] - low[0], high[1] - low[1]) * 1.1;
  const step = reach > 600 ? 50 : reach > 250 ? 20 : 10;
  const fade = (x, y) => 0.2 * Math.max(0, 1 - Math.hypot(x - middle[0], y - middle[1]) / reach);
  const first = [0, 1].map((k) => Math.ceil((middle[k] - reach) / step) * step);
  const pieces = 8;
  const length = (2 * reach) / pieces;
  for (let u = 0; u * step <= 2 * reach; u++) {
    for (let piece = 0; piece < pieces; piece++) {
      for (const swap of [false, true]) {
        const begin = [first[0] + u * step, middle[1] - reach + piece * length];
        const end = [begin[0], begin[1] + length];
        const [a, b] = [begin, end].map(([p, q]) => (swap ? [q - middle[1] + middle[0], p - first[0] + first[1]] : [p, q]));
        const [fadeA, fadeB] = [fade(...a), fade(...b)];
        if (fadeA + fadeB > 0.004) line([...a, 0], [...b, 0], [0.55, 0.68, 1, fadeA], [0.55, 0.68, 1, fadeB]);
      }
    }
  }
  // Squares for the pads; of a great fleet only one edge of each, which costs a quarter.
  const pad = 0.25;
  const strength = Math.max(0.08, 0.4 / show.drones ** 0.2 - 0.02);
  const edges = show.drones > 200 ? 1 : 4;
  for (const [x, y, z] of show.pads) {
    const corners = [[x - pad, y - pad, z], [x + pad, y - pad, z], [x + pad, y + pad, z], [x - pad, y + pad, z]];
    for (let k = 0; k < edges; k++) line(corners[k], corners[(k + 1) % 4], [0.6, 0.7, 0.9, strength]);
  }
  const orange = [1, 0.6, 0.25];
  show.fence.forEach(([x, y], k) => {
    const [nx, ny] = show.fence[(k + 1) % show.fence.length];
    line([x, y, 0], [nx, ny, 0], [...orange, 0.55]);
    if (show.ceiling !== null) line([x, y, show.ceiling], [nx, ny, show.ceiling], [...orange, 0.1]);
    line([x, y, 0], [x, y, show.ceiling ?? show.bounds[1][2]], [...orange, 0.3], [...orange, 0.08]);
  });
  if (show.heading !== null) {
    const [tip, root] = northArrow();
    line(root, tip, [1, 0.4, 0.4, 0.7]);
  }
  return { places, tints };
}

function northArrow() {
  const bearing = (show.heading * Math.PI) / 180;
  const towards = [-Math.sin(bearing), Math.cos(bearing)];
  const [low] = show.ground;
  const length = 5;
  return [[low[0] + towards[0] * length, low[1] + towards[1] * length, 0], [low[0], low[1], 0]];
}
