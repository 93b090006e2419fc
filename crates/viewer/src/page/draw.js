// Draws views from photos and their depth, by WebGL 2: each photo's depth on the target, the depths fused, holes filled from smaller and smaller
// sizes, then each pixel blended from the photos that see it.

const SLOTS = 5;
// Photos whose depth makes the surface: some more, at rest.
const DEPTHS = 6;
// Disparities up to this many times that of the nearest depth of the scene are drawn.
const CLOSER = 8;
// Photos whose textures stay.
const KEPT_TEXTURES = 32;
// Texture reads a pixel, at most: six depths fused, one filled, 3×3 disparities, on three layers a colour and a depth of four photos each, the picture
// shown, and of smaller sizes, a third as many pixels, five each for the depth and for the picture. A hole of the depth takes four more, but has two
// layers; so has all while a fifth photo fades in.
const READS = 6 + 1 + 9 + 24 + 1 + 4;
// Texture units of the shaders' samplers.
const UNITS = { own: 0, smaller: 1, surface: 2, photo: 3, depths: 4, photos: 4, codes: 10, code: 10 };

class Drawer {
  // Throws if there is no WebGL 2.
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("WebGL 2 is missing");
    [this.gl, this.canvas, this.kept, this.targets] = [gl, canvas, [], undefined];
    const program = (vertex, fragment) => this.program(vertex, fragment);
    this.points = program("points.vert", "points.frag");
    this.fuse = program("screen.vert", "fuse.frag");
    this.shrink = program("screen.vert", "shrink.frag");
    this.fill = program("screen.vert", "fill.frag");
    this.blend = program("screen.vert", "blend.frag");
    this.show = program("screen.vert", "show.frag");
    this.sharpen = program("screen.vert", "sharpen.frag");
    this.empty = gl.createVertexArray();
    this.noPhoto = this.texture(gl.RGBA8, 1, 1, gl.LINEAR);
    this.noCode = this.texture(gl.R16UI, 1, 1, gl.NEAREST);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  }

  program(...names) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const name of names) {
      const shader = gl.createShader(name.endsWith(".vert") ? gl.VERTEX_SHADER : gl.FRAGMENT_SHADER);
      gl.shaderSource(shader, (document.getElementById("common.glsl").textContent + document.getElementById(name).textContent).trim());
      gl.compileShader(shader);
      gl.attachShader(program, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(`${name}: ${gl.getShaderInfoLog(shader)}`);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(`${names}: ${gl.getProgramInfoLog(program)}`);
    const places = {};
    gl.useProgram(program);
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i += 1) {
      const { name, size } = gl.getActiveUniform(program, i);
      const [plain, place] = [name.replace("[0]", ""), gl.getUniformLocation(program, name)];
      if (plain in UNITS) gl.uniform1iv(place, Array.from({ length: size }, (_, at) => UNITS[plain] + at));
      else places[plain] = place;
    }
    return { program, places };
  }

  texture(format, w, h, filter, levels = 1) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, levels, format, w, h);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, levels > 1 ? gl.LINEAR_MIPMAP_NEAREST : filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, axis, gl.CLAMP_TO_EDGE);
    return texture;
  }

  // A texture that is drawn to.
  target(format, w, h, filter, attachment, levels = 1) {
    const { gl } = this;
    const target = { texture: this.texture(format, w, h, filter, levels), frame: gl.createFramebuffer(), w, h };
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, attachment, gl.TEXTURE_2D, target.texture, 0);
    return target;
  }

  // The textures between the passes, of this size; those of the last size are dropped.
  prepare(w, h) {
    const { gl } = this;
    if (this.targets?.w === w && this.targets.h === h) return;
    for (const { texture, frame } of this.targets?.all ?? []) {
      gl.deleteTexture(texture);
      gl.deleteFramebuffer(frame);
    }
    const pyramid = (filter) => {
      const levels = [];
      for (let [x, y] = [w, h]; ; [x, y] = [Math.ceil(x / 2), Math.ceil(y / 2)]) {
        levels.push(this.target(gl.RGBA8, x, y, filter, gl.COLOR_ATTACHMENT0));
        if (x === 1 && y === 1) return levels;
      }
    };
    const depths = Array.from({ length: DEPTHS }, () => this.target(gl.DEPTH_COMPONENT24, w, h, gl.NEAREST, gl.DEPTH_ATTACHMENT));
    const [fused, filled, shrunk, pictures] = [pyramid(gl.NEAREST), pyramid(gl.NEAREST), pyramid(gl.LINEAR), pyramid(gl.LINEAR)];
    this.targets = { w, h, depths, fused, filled, shrunk, pictures, all: [...depths, ...fused, ...filled, ...shrunk, ...pictures] };
  }

  // Puts a photo, and its depth once it is there, into textures.
  upload(photo) {
    const { gl } = this;
    this.kept = [photo, ...this.kept.filter((other) => other !== photo)];
    while (this.kept.length > KEPT_TEXTURES) this.free(this.kept.pop());
    const amount = photo.sharpness ?? 0;
    if (photo.texture && photo.sharpened !== amount) {
      gl.deleteTexture(photo.texture);
      photo.texture = undefined;
    }
    if (!photo.texture) {
      photo.sharpened = amount;
      const { width, height } = photo.bitmap;
      const levels = 1 + Math.floor(Math.log2(Math.max(width, height)));
      const plain = this.texture(gl.RGBA8, width, height, gl.LINEAR, levels);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, gl.RGBA, gl.UNSIGNED_BYTE, photo.bitmap);
      photo.texture = plain;
      if (amount > 0) {
        const sharp = this.target(gl.RGBA8, width, height, gl.LINEAR, gl.COLOR_ATTACHMENT0, levels);
        this.bind(UNITS.own, plain);
        this.pass(sharp, this.sharpen, { amount });
        gl.deleteFramebuffer(sharp.frame);
        gl.deleteTexture(plain);
        photo.texture = sharp.texture;
        gl.bindTexture(gl.TEXTURE_2D, photo.texture);
      }
      gl.generateMipmap(gl.TEXTURE_2D);
    }
    if (photo.depth && !photo.code) {
      const { codes, width, height } = photo.depth;
      photo.code = this.texture(gl.R16UI, width, height, gl.NEAREST);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RED_INTEGER, gl.UNSIGNED_SHORT, codes);
    }
  }

  free(photo) {
    const { gl } = this;
    gl.deleteTexture(photo.texture ?? null);
    gl.deleteTexture(photo.code ?? null);
    [photo.texture, photo.code] = [undefined, undefined];
  }

  use({ program, places }, values) {
    const { gl } = this;
    gl.useProgram(program);
    for (const [name, value] of Object.entries(values)) {
      const place = places[name];
      if (place === undefined) continue;
      if (typeof value === "boolean") gl.uniform1i(place, Number(value));
      else if (typeof value === "number") gl.uniform1f(place, value);
      else gl[value[0]](place, ...(value[0].startsWith("uniformMatrix") ? [true, value[1]] : [value[1]]));
    }
  }

  bind(unit, texture) {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, texture);
  }

  // A pass over all pixels of a target; `null`: the canvas.
  pass(target, program, values) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, target?.frame ?? null);
    gl.viewport(0, 0, target?.w ?? this.canvas.width, target?.h ?? this.canvas.height);
    gl.bindVertexArray(this.empty);
    this.use(program, values);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // Fills the holes of the first of `levels` from its means at half, a quarter … of the size; `into` gets all sizes without holes, from `first` on. What
  // is not sure stays at the full size alone.
  fillHoles(levels, into, packed, first) {
    for (let i = 1; i < levels.length; i += 1) {
      this.bind(UNITS.own, levels[i - 1].texture);
      this.pass(levels[i], this.shrink, { packed });
    }
    for (let i = levels.length - 2; i >= first; i -= 1) {
      this.bind(UNITS.own, levels[i].texture);
      this.bind(UNITS.smaller, i === levels.length - 2 ? levels[i + 1].texture : into[i + 1].texture);
      this.pass(into[i], this.fill, { packed, least: i > 0 ? 0.6 : 0 });
    }
  }

  // Draws a camera from photos. `slots`: [{ photo, weight (0 to 1) }], nearest first; `stride`: of the pixels of depth, one of so many across and down; `near`, `far`:
  // depths of the scene; `helpers`: photos whose depth alone is used. What it drew is then shown by `present`.
  draw(camera, slots, { near, far, helpers = [], stride = 1, three = true }) {
    const { gl } = this;
    const [w, h] = [camera.w, camera.h];
    this.prepare(w, h);
    const { depths, fused, filled, shrunk, pictures } = this.targets;
    const all = [...slots.map(({ photo }) => photo), ...helpers];
    all.forEach((photo) => this.upload(photo));
    const pose = poseOf(camera);
    const distances = slots.map(({ photo }) => distance(photo.pose.centre, pose.centre));
    const largest = CLOSER / near;
    this.largest = largest;
    this.vertices = 0;
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.bindVertexArray(this.empty);
    const withDepth = all.filter((photo) => photo.code).slice(0, DEPTHS);
    withDepth.forEach((photo, i) => {
      gl.bindFramebuffer(gl.FRAMEBUFFER, depths[i].frame);
      gl.viewport(0, 0, w, h);
      gl.clear(gl.DEPTH_BUFFER_BIT);
      const { H, e } = sweep(camera, photo.camera);
      const count = Math.floor(photo.depth.width / stride) * Math.floor(photo.depth.height / stride);
      this.bind(UNITS.code, photo.code);
      this.use(this.points, {
        H: ["uniformMatrix3fv", H.flat()], e: ["uniform3fv", e], size: ["uniform2fv", [w, h]], largest,
        stride: ["uniform1i", stride], unit: photo.depth.step, focal: camera.fl_x / photo.camera.fl_x,
      });
      gl.drawArrays(gl.POINTS, 0, count);
      this.vertices += count;
    });
    gl.disable(gl.DEPTH_TEST);
    // Disparity of a pixel of parallax, in the photo that has most of it.
    const parallax = Math.max(...slots.map(({ photo }, i) => Math.max(photo.camera.fl_x, 0) * distances[i]), 1e-12);
    const smallest = Math.min(...withDepth.map((photo) => photo.depth.pixel));
    const pixel = Math.min(1 / parallax, Number.isFinite(smallest) ? 2 * smallest : Infinity);
    if (withDepth.length > 0) {
      depths.forEach(({ texture }, i) => this.bind(UNITS.depths + i, texture));
      this.pass(fused[0], this.fuse, { count: ["uniform1i", withDepth.length], same: (2 * pixel) / largest, averaged: (3 * pixel) / largest });
      this.fillHoles(fused, filled, true, 0);
    } else {
      // Nothing is known yet: a plane in the middle.
      const share = (1 / near + (far ? 1 / far : 0)) / 2 / largest;
      gl.bindFramebuffer(gl.FRAMEBUFFER, filled[0].frame);
      gl.clearColor(share, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
    }
    const nearest = Math.min(...distances.filter((d) => d > 0), Infinity);
    const gains = exposureGains(slots.map(({ photo }) => photo), distances);
    const values = { H: [], e: [], sizes: [], gains: [], scales: [] };
    slots.forEach(({ photo, weight }, i) => {
      const { H, e } = sweep(photo.camera, camera);
      values.H.push(...H.flat());
      values.e.push(...e);
      values.sizes.push(photo.camera.w, photo.camera.h);
      const bias = 1.5 * Math.log(Math.max(nearest, 1e-300) / Math.max(distances[i], 1e-4 * nearest, 1e-300));
      values.gains.push(...gains[i], Number.isFinite(bias) ? bias : 0);
      const detail = Math.log2(Math.max(1, (photo.camera.fl_x / camera.fl_x) * 0.7));
      values.scales.push(photo.depth?.step ?? 0, photo.code ? 4 * photo.depth.pixel : 0, weight, Math.round(detail));
    });
    for (let i = 0; i < SLOTS; i += 1) {
      this.bind(UNITS.photos + i, slots[i]?.photo.texture ?? this.noPhoto);
      this.bind(UNITS.codes + i, slots[i]?.photo.code ?? this.noCode);
    }
    this.bind(UNITS.surface, filled[0].texture);
    this.bind(UNITS.smaller, filled[1].texture);
    this.pass(pictures[0], this.blend, {
      H: ["uniformMatrix3fv", values.H], count: ["uniform1i", slots.length], largest, fine: (0.25 * pixel) / largest, three,
      e: ["uniform3fv", values.e], sizes: ["uniform2fv", values.sizes], gains: ["uniform4fv", values.gains], scales: ["uniform4fv", values.scales],
    });
    this.fillHoles(pictures, shrunk, false, 1);
    this.near = near;
    this.far = far;
  }

  // Shows what was drawn, if anything was. `photo`: one to compare with, on this share of the width.
  present({ depth = false, guessed = false, fade = 0, wipe = 0, photo, ground = [0, 0, 0] }) {
    const none = [{ texture: this.noPhoto }, { texture: this.noPhoto }];
    const { pictures, shrunk, filled } = this.targets ?? { pictures: none, shrunk: none, filled: none };
    if (photo) this.upload(photo);
    this.bind(UNITS.own, pictures[0].texture);
    this.bind(UNITS.smaller, (shrunk.length > 2 ? shrunk : pictures)[1].texture);
    this.bind(UNITS.surface, filled[0].texture);
    this.bind(UNITS.photo, photo?.texture ?? this.noPhoto);
    this.pass(null, this.show, {
      size: ["uniform2fv", [this.canvas.width, this.canvas.height]], depth, guessed, fade, wipe: photo ? wipe : 0, ground: ["uniform3fv", ground],
      span: ["uniform2fv", [(this.far ? 1 / this.far : 0) / this.largest, 1 / this.near / this.largest]],
    });
  }

  // The depth drawn in the middle of the picture, scene units; undefined where there is none.
  middleDepth() {
    const { gl } = this;
    if (!this.targets) return undefined;
    const { frame, w, h } = this.targets.filled[0];
    const found = new Uint8Array(4);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.readPixels(w >> 1, h >> 1, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, found);
    const share = found[0] / 255 + found[1] / 255 ** 2 + found[2] / 255 ** 3;
    return share > 0 ? 1 / (share * this.largest) : undefined;
  }

  // The pixels of the canvas, row by row from the top.
  pixels() {
    const { gl, canvas } = this;
    const [{ width, height }, rows] = [canvas, new Uint8Array(4 * canvas.width * canvas.height)];
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rows);
    const flipped = new Uint8ClampedArray(rows.length);
    for (let y = 0; y < height; y += 1) flipped.set(rows.subarray(4 * width * (height - 1 - y), 4 * width * (height - y)), 4 * width * y);
    return flipped;
  }
}
