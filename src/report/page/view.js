// A turnable view, orthographic: a ball whose dots are computed pixel by pixel, and shaded meshes. One
// hidden WebGL canvas draws for all views, whose own canvases are plain pictures: these print.

const MAX_DOTS = 64,
  MAX_ZONES = 8;

const BALL_VERTEX = `#version 300 es
in vec2 corner; uniform vec2 reach; uniform vec3 center; uniform float radius, depth; out vec2 p;
void main() { p = corner * 1.02; gl_Position = vec4((center.xy + p * radius) / reach, 0.0, 1.0); }`;

const BALL_FRAGMENT = `#version 300 es
precision highp float;
in vec2 p; out vec4 color;
uniform mat3 back; uniform vec3 center; uniform float radius, depth, dotCos, seamHalf;
uniform int dots, zones, chosen; uniform vec3 dot_[${MAX_DOTS}]; uniform vec4 zone_[${MAX_ZONES}];
uniform vec3 seam, cBall, cDot, cZone, cSeam, cChosen;
uniform bool painted; uniform sampler2D paint;
void main() {
  float rr = dot(p, p), w = fwidth(length(p));
  float edge = 1.0 - smoothstep(1.0 - w, 1.0, sqrt(rr));
  if (edge <= 0.0) discard;
  vec3 n = vec3(p, sqrt(max(0.0, 1.0 - rr)));
  vec3 d = back * n;
  vec3 c = cBall;
  float soft = 1.2 * w / max(n.z, 0.25);
  if (painted) {
    // By latitude and longitude; red is the shade, green says whether it is known.
    vec2 at = vec2(0.5 + atan(d.y, d.x) / 6.2831853, acos(clamp(d.z, -1.0, 1.0)) / 3.1415927);
    vec2 seen = textureLod(paint, at, 0.0).rg;
    float stripe = smoothstep(0.35, 0.5, abs(fract((d.x + d.y + d.z) * 9.0) - 0.5));
    vec3 unknown = mix(cZone, cBall, 0.55 + 0.3 * stripe);
    vec3 known = mix(cDot, cBall, seen.r / max(seen.g, 0.01));
    c = mix(unknown, known, smoothstep(0.45, 0.55, seen.g));
  }
  for (int i = 0; i < zones; i++) {
    float a = acos(clamp(dot(d, zone_[i].xyz), -1.0, 1.0)) - zone_[i].w;
    float stripe = smoothstep(0.35, 0.5, abs(fract((d.x + d.y + d.z) * 9.0) - 0.5));
    c = mix(c, mix(cZone, cBall, 0.55 + 0.3 * stripe), 1.0 - smoothstep(-soft, soft, a));
    c = mix(c, cZone, 1.0 - smoothstep(0.010, 0.010 + soft, abs(a)));
  }
  if (seamHalf > 0.0) c = mix(c, cSeam, 1.0 - smoothstep(seamHalf, seamHalf + soft, abs(dot(d, seam))));
  for (int i = 0; i < dots; i++) {
    float a = acos(clamp(dot(d, dot_[i]), -1.0, 1.0)) - acos(dotCos);
    c = mix(c, cDot, 1.0 - smoothstep(-soft, soft, a));
    if (i == chosen) c = mix(c, cChosen, 1.0 - smoothstep(0.02, 0.02 + soft, abs(a - 0.035)));
  }
  float lit = 0.66 + 0.34 * max(0.0, dot(n, normalize(vec3(-0.35, 0.45, 0.82))));
  color = vec4(c * lit, edge);
  gl_FragDepth = 0.5 - 0.5 * (center.z + n.z * radius) / depth;
}`;

const MESH_VERTEX = `#version 300 es
in vec3 place; in vec3 normal; out vec3 n, own;
uniform mat3 turn; uniform vec3 shift, low, size; uniform vec2 reach; uniform float depth;
void main() {
  own = low + place * size;
  vec3 q = turn * own + shift;
  n = turn * normal;
  gl_Position = vec4(q.xy / reach, -q.z / depth, 1.0);
}`;

const MESH_FRAGMENT = `#version 300 es
precision highp float;
in vec3 n, own; out vec4 color; uniform vec3 paint, hub; uniform float ground;
void main() {
  vec3 m = normalize(n);
  if (!gl_FrontFacing) m = -m;
  float lit = 0.40 + 0.60 * max(0.0, dot(m, normalize(vec3(-0.45, 0.55, 0.71))));
  // The floor of an engraving is darker, so that it can be read.
  float sunk = abs(distance(own, hub) - ground) < 0.1 ? 0.5 : 1.0;
  color = vec4(paint * lit * sunk * (gl_FrontFacing ? 1.0 : 0.7), 1.0);
}`;

/** The numbers of a base64 text as an array of `type`. */
function numbers(text, type) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new type(bytes.buffer);
}

/**
 * Corners of a mesh for drawing: places in [0, 1] of its box and normals, smooth within faces and
 * sharp at edges of more than 35 degrees. `mesh`: { low, size, places (u16), triangles (u32) }.
 */
function corners(mesh) {
  const p = numbers(mesh.places, Uint16Array),
    t = numbers(mesh.triangles, Uint32Array);
  const at = (v, i) => mesh.low[i] + (p[3 * v + i] / 65535) * mesh.size[i];
  const faces = t.length / 3,
    normal = new Float32Array(3 * faces),
    around = Array.from({ length: p.length / 3 }, () => []);
  for (let f = 0; f < faces; f++) {
    const [a, b, c] = [t[3 * f], t[3 * f + 1], t[3 * f + 2]];
    const u = [0, 1, 2].map((i) => at(b, i) - at(a, i)),
      v = [0, 1, 2].map((i) => at(c, i) - at(a, i));
    // Longer for larger faces: they count for more.
    normal.set(
      [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]],
      3 * f,
    );
    for (const k of [a, b, c]) around[k].push(f);
  }
  const places = new Float32Array(9 * faces),
    normals = new Float32Array(9 * faces);
  const of = (f) => [normal[3 * f], normal[3 * f + 1], normal[3 * f + 2]];
  for (let f = 0; f < faces; f++) {
    const own = of(f),
      length = Math.hypot(...own);
    for (let k = 0; k < 3; k++) {
      const v = t[3 * f + k],
        sum = [0, 0, 0];
      for (const g of around[v]) {
        const other = of(g);
        if (dot(own, other) > 0.82 * length * Math.hypot(...other))
          for (let i = 0; i < 3; i++) sum[i] += other[i];
      }
      const size = Math.hypot(...sum) || 1;
      for (let i = 0; i < 3; i++) {
        places[9 * f + 3 * k + i] = p[3 * v + i] / 65535;
        normals[9 * f + 3 * k + i] = sum[i] / size;
      }
    }
  }
  return { low: mesh.low, size: mesh.size, places, normals, count: 3 * faces };
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
      throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}

/**
 * A view to turn. `scene(view)` returns { reach, ball: { center, radius, turn, dots, names, dotAngle, zones, seam,
 * seamHalf, chosen, paint } or null, meshes: [{ mesh, turn, shift, paint, hub, ground }], labels: [{ at, text, color, hidden }],
 * lines: [{ from, to, color, width }] } in the scene's frame, lengths alike. Drag, touch or arrow keys
 * turn it, + and - zoom, Home resets. `hover(direction or null, x, y, view)` hears of the ball's point under
 * the pointer, in the ball's own frame.
 */
class View {
  constructor(label, scene, { turn = IDENTITY, hover = null, key = null } = {}) {
    this.scene = scene;
    this.first = turn;
    this.turn = turn;
    this.zoom = 1;
    this.hover = hover;
    this.key = key;
    this.canvas = el("canvas", { class: "view", tabindex: 0, role: "img", "aria-label": label });
    this.node = el("div", { class: "stage" }, this.canvas);
    this.stage = View.stage ??= new Stage();
    if (!this.stage.gl) {
      this.node.replaceChildren(
        el("p", {
          class: "notice",
          text: "This view needs WebGL 2, which this browser does not offer.",
        }),
      );
      return;
    }
    this.listen();
    RESTYLED.push(() => this.draw());
    new ResizeObserver(() => this.draw()).observe(this.node);
    addEventListener("beforeprint", () => this.paint());
  }

  listen() {
    const touches = new Map();
    let pinch = 0;
    const spread = () => {
      const [a, b] = [...touches.values()];
      return Math.hypot(a.x - b.x, a.y - b.y);
    };
    this.canvas.addEventListener("pointerdown", (e) => {
      this.canvas.setPointerCapture(e.pointerId);
      touches.set(e.pointerId, { x: e.clientX, y: e.clientY });
      if (touches.size === 2) pinch = spread() / this.zoom;
      if (this.hover) this.hover(null);
    });
    this.canvas.addEventListener("pointermove", (e) => {
      const before = touches.get(e.pointerId);
      if (!before) return this.point(e);
      const dx = e.clientX - before.x,
        dy = e.clientY - before.y;
      touches.set(e.pointerId, { x: e.clientX, y: e.clientY });
      if (touches.size === 2) {
        this.zoom = Math.max(0.5, Math.min(6, spread() / pinch));
        return this.draw();
      }
      const length = Math.hypot(dx, dy);
      if (length > 0)
        this.rotate(
          [dy / length, dx / length, 0],
          (length * 2.6) / this.canvas.clientWidth / this.zoom,
        );
    });
    const end = (e) => touches.delete(e.pointerId);
    for (const name of ["pointerup", "pointercancel"]) this.canvas.addEventListener(name, end);
    this.canvas.addEventListener("pointerleave", () => this.hover && this.hover(null));
    this.canvas.addEventListener("keydown", (e) => {
      const axes = {
        ArrowLeft: [0, -1, 0],
        ArrowRight: [0, 1, 0],
        ArrowUp: [-1, 0, 0],
        ArrowDown: [1, 0, 0],
      };
      if (axes[e.key]) this.rotate(axes[e.key], (e.shiftKey ? 1 : 6) * DEG);
      else if (e.key === "+" || e.key === "=") this.scaled(1.15);
      else if (e.key === "-") this.scaled(1 / 1.15);
      else if (e.key === "Home") this.reset();
      else if (!(this.key && this.key(e.key))) return;
      e.preventDefault();
    });
  }

  rotate(axis, angle) {
    this.turn = orthonormal(multiply(rotation(axis, angle), this.turn));
    this.draw();
  }
  scaled(by) {
    this.zoom = Math.max(0.5, Math.min(6, this.zoom * by));
    this.draw();
  }
  reset() {
    this.turn = this.first;
    this.zoom = 1;
    this.draw();
  }
  /** Turns a direction of the scene's frame towards the viewer. */
  face(direction) {
    const d = times(this.turn, direction),
      axis = [d[1], -d[0], 0],
      sine = Math.hypot(axis[0], axis[1]);
    if (sine > 1e-6)
      this.rotate(
        axis.map((c) => c / sine),
        Math.atan2(sine, d[2]),
      );
    else if (d[2] < 0) this.rotate([0, 1, 0], Math.PI);
  }

  point(e) {
    if (!this.hover || !this.drawn || !this.drawn.ball) return;
    const box = this.canvas.getBoundingClientRect(),
      ball = this.drawn.ball;
    const c = times(this.turn, ball.center);
    const x = (((e.clientX - box.left) / box.width) * 2 - 1) * this.reach[0],
      y = (1 - ((e.clientY - box.top) / box.height) * 2) * this.reach[1];
    const p = [(x - c[0]) / ball.radius, (y - c[1]) / ball.radius],
      rest = 1 - p[0] ** 2 - p[1] ** 2;
    if (rest < 0) return this.hover(null);
    this.hover(
      times(transpose(multiply(this.turn, ball.turn)), [...p, Math.sqrt(rest)]),
      e.pageX,
      e.pageY,
    );
  }

  /** Asks for a picture; several in a row make one. */
  draw() {
    if (this.asked || !this.stage.gl) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.paint();
    });
  }

  paint() {
    const width = this.node.clientWidth,
      height = this.node.clientHeight;
    if (!this.stage.gl || !width || !height) return;
    const dense = Math.min(2, Math.max(1.5, devicePixelRatio)),
      size = [Math.round(width * dense), Math.round(height * dense)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) {
      this.canvas.width = size[0];
      this.canvas.height = size[1];
    }
    const drawn = (this.drawn = this.scene(this)),
      least = Math.min(width, height);
    this.reach = [
      (drawn.reach * width) / least / this.zoom,
      (drawn.reach * height) / least / this.zoom,
    ];
    const ink = this.canvas.getContext("2d");
    ink.setTransform(1, 0, 0, 1, 0, 0);
    ink.drawImage(this.stage.paint(drawn, this.turn, this.reach, size), 0, 0);
    ink.setTransform(dense, 0, 0, dense, 0, 0);
    this.paintOver(ink, drawn, width, height);
    this.canvas.dataset.turn = this.turn.map((c) => c.toFixed(4)).join(",");
  }

  paintOver(ink, drawn, width, height) {
    const place = (v) => {
      const q = times(this.turn, v);
      return [((q[0] / this.reach[0] + 1) * width) / 2, ((1 - q[1] / this.reach[1]) * height) / 2];
    };
    ink.lineCap = "round";
    for (const line of drawn.lines || []) {
      const [a, b] = [place(line.from), place(line.to)];
      ink.strokeStyle = css(line.color);
      ink.lineWidth = line.width || 2;
      ink.beginPath();
      ink.moveTo(a[0], a[1]);
      ink.lineTo(b[0], b[1]);
      ink.stroke();
    }
    ink.textAlign = "center";
    ink.textBaseline = "middle";
    for (const label of drawn.labels || []) {
      const [x, y] = place(label.at),
        [dx, dy] = label.offset || [0, 0];
      ink.font = `600 ${label.size || 13}px system-ui, sans-serif`;
      ink.fillStyle = label.color.startsWith("--") ? css(label.color) : label.color;
      ink.fillText(label.text, x + dx, y + dy);
    }
  }
}

/** The WebGL canvas that draws scenes. */
class Stage {
  constructor() {
    this.canvas = el("canvas");
    const gl = (this.gl = this.canvas.getContext("webgl2", {
      antialias: true,
      alpha: true,
      premultipliedAlpha: false,
      preserveDrawingBuffer: true,
    }));
    if (!gl) return;
    this.buffers = new Map();
    this.ballProgram = program(gl, BALL_VERTEX, BALL_FRAGMENT);
    this.meshProgram = program(gl, MESH_VERTEX, MESH_FRAGMENT);
    this.quad = this.buffer(new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
    this.textures = new Map();
  }

  /** A surface { columns, rows, values } as a texture; of none one that is not read. */
  texture(paint) {
    const gl = this.gl;
    if (this.textures.has(paint)) return this.textures.get(paint);
    const bytes = paint ? numbers(paint.values, Uint8Array) : new Uint8Array(1),
      pairs = Uint8Array.from({ length: 2 * bytes.length }, (_, k) =>
        k % 2 ? (bytes[k >> 1] ? 255 : 0) : bytes[k >> 1],
      ),
      made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG8, paint?.columns ?? 1, paint?.rows ?? 1, 0, gl.RG, gl.UNSIGNED_BYTE, pairs);
    for (const [name, value] of [
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR],
      [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.REPEAT],
      [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ])
      gl.texParameteri(gl.TEXTURE_2D, name, value);
    this.textures.set(paint, made);
    return made;
  }

  buffer(data) {
    const made = this.gl.createBuffer();
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, made);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, data, this.gl.STATIC_DRAW);
    return made;
  }

  /** Draws a scene seen through `turn`, `reach` to either side, and returns the canvas. */
  paint(drawn, turn, reach, size) {
    const gl = this.gl;
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) {
      this.canvas.width = size[0];
      this.canvas.height = size[1];
    }
    this.turn = turn;
    this.reach = reach;
    const depth = 4 * drawn.reach;
    gl.viewport(0, 0, size[0], size[1]);
    gl.clearColor(...rgb("--stage"), 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    for (const part of drawn.meshes || []) this.paintMesh(part, depth);
    if (drawn.ball) this.paintBall(drawn.ball, depth);
    return this.canvas;
  }

  paintMesh({ mesh, turn, shift, paint, hub, ground }, depth) {
    const gl = this.gl,
      at = (name) => gl.getUniformLocation(this.meshProgram, name);
    if (!this.buffers.has(mesh))
      this.buffers.set(mesh, [this.buffer(mesh.places), this.buffer(mesh.normals)]);
    gl.useProgram(this.meshProgram);
    ["place", "normal"].forEach((name, i) => {
      const k = gl.getAttribLocation(this.meshProgram, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers.get(mesh)[i]);
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 0, 0);
    });
    gl.uniformMatrix3fv(at("turn"), true, multiply(this.turn, turn));
    gl.uniform3fv(at("shift"), times(this.turn, shift));
    gl.uniform3fv(at("low"), mesh.low);
    gl.uniform3fv(at("size"), mesh.size);
    gl.uniform2fv(at("reach"), this.reach);
    gl.uniform1f(at("depth"), depth);
    gl.uniform3fv(at("paint"), rgb(paint));
    gl.uniform3fv(at("hub"), hub);
    gl.uniform1f(at("ground"), ground);
    gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
  }

  paintBall(ball, depth) {
    const gl = this.gl,
      at = (name) => gl.getUniformLocation(this.ballProgram, name);
    gl.useProgram(this.ballProgram);
    const k = gl.getAttribLocation(this.ballProgram, "corner");
    gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
    gl.enableVertexAttribArray(k);
    gl.vertexAttribPointer(k, 2, gl.FLOAT, false, 0, 0);
    gl.uniform2fv(at("reach"), this.reach);
    gl.uniform3fv(at("center"), times(this.turn, ball.center));
    gl.uniform1f(at("radius"), ball.radius);
    gl.uniform1f(at("depth"), depth);
    // The transpose maps back to the ball's frame; WebGL takes it so without being asked to transpose.
    gl.uniformMatrix3fv(at("back"), false, multiply(this.turn, ball.turn));
    gl.uniform1i(at("dots"), Math.min(MAX_DOTS, ball.dots.length));
    if (ball.dots.length) gl.uniform3fv(at("dot_"), ball.dots.slice(0, MAX_DOTS).flat());
    gl.uniform1f(at("dotCos"), Math.cos(ball.dotAngle));
    const zones = (ball.zones || []).slice(0, MAX_ZONES);
    gl.uniform1i(at("zones"), zones.length);
    if (zones.length)
      gl.uniform4fv(
        at("zone_"),
        zones.flatMap((z) => [...z.axis, z.half_angle_rad]),
      );
    gl.uniform3fv(at("seam"), ball.seam || [0, 0, 1]);
    gl.uniform1f(at("seamHalf"), ball.seam ? 0.006 : 0);
    gl.uniform1i(at("chosen"), ball.chosen ?? -1);
    const paint = ball.paint ?? null;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.texture(paint));
    gl.uniform1i(at("paint"), 0);
    gl.uniform1i(at("painted"), paint ? 1 : 0);
    for (const [name, color] of [
      ["cBall", "--ball"],
      ["cDot", "--dot"],
      ["cZone", "--zone"],
      ["cSeam", "--seam"],
      ["cChosen", "--accent"],
    ])
      gl.uniform3fv(at(name), rgb(color));
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }
}

/**
 * Labels of a ball's dots that face the viewer: white on the dot where it is large enough, else beside it where no
 * other dot or label is.
 */
function dotLabels(view, ball, reach) {
  const out = multiply(view.turn, ball.turn),
    scale =
      (Math.min(view.node.clientWidth, view.node.clientHeight) / 2 / reach) *
      view.zoom *
      ball.radius;
  const large = Math.sin(ball.dotAngle) * scale,
    size = 13;
  // Those nearest to the viewer choose first.
  const shown = ball.dots
    .map((d, i) => ({ d, seen: times(out, d), text: String(ball.names ? ball.names[i] : i) }))
    .filter((dot) => dot.seen[2] >= 0.1)
    .sort((a, b) => b.seen[2] - a.seen[2]);
  const taken = [];
  const isFree = (x, y, own) =>
    taken.every((p) => Math.hypot(p[0] - x, p[1] - y) > 1.2 * size) &&
    shown.every(
      (dot) =>
        dot === own ||
        Math.hypot(dot.seen[0] * scale - x, -dot.seen[1] * scale - y) > large + 0.45 * size,
    );
  return shown.flatMap((dot) => {
    const { d, seen, text } = dot,
      z = seen[2];
    const at = times(ball.turn, d).map((c, k) => c * ball.radius + ball.center[k]);
    if (large * z > 4.5 * text.length + 2.5) return [{ at, text, color: "#ffffff", size }];
    // Beside it, first towards the ball's middle: its rim is an ellipse that is narrow in that direction.
    const inwards = Math.atan2(seen[1], -seen[0]);
    for (const turn of [0, 45, -45, 90, -90, 135, -135, 180]) {
      const angle = inwards + turn * DEG,
        narrow = Math.abs(Math.cos(turn * DEG)),
        by = large * (z * narrow + 1 - narrow) + 10,
        offset = [Math.cos(angle) * by, Math.sin(angle) * by],
        x = seen[0] * scale + offset[0],
        y = -seen[1] * scale + offset[1];
      if (!isFree(x, y, dot)) continue;
      taken.push([x, y]);
      return [{ at, text, color: "#1d2330", size, offset }];
    }
    return [];
  });
}

/** The axes of the ball's frame as a tripod beside the ball. */
function tripod(view, turn, reach) {
  const back = transpose(view.turn),
    z = view.zoom,
    corner = times(back, [(-0.82 * reach) / z, (-0.82 * reach) / z, reach]);
  const lines = [],
    labels = [];
  const axes = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ].map((axis) => times(turn, axis));
  const seen = axes.map((d) => times(view.turn, d));
  axes.forEach((d, i) => {
    const to = corner.map((c, k) => c + (d[k] * 0.13 * reach) / z);
    lines.push({ from: corner, to, color: "--soft", width: 2 });
    // Beyond the axis' end; that of an axis which is seen end on stands away from the others.
    const long = Math.hypot(seen[i][0], seen[i][1]),
      others = [0, 1].map((k) => -seen.reduce((sum, s, j) => (j === i ? sum : sum + s[k]), 0)),
      way = long > 0.35 ? seen[i] : others,
      by = 9 / (Math.hypot(way[0], way[1]) || 1);
    labels.push({
      at: to,
      text: "xyz"[i],
      color: "--soft",
      size: 12,
      offset: [way[0] * by, -way[1] * by],
    });
  });
  return { lines, labels };
}
