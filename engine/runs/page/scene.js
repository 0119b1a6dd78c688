// The 3D view, drawn by three.js: panels, target and labels, orbited with mouse, fingers or keys. Frames are drawn only on changes.

const FROM = [0.45, -0.8, 0.55]; // direction from the piece to the camera in the first view
const TURN_KEY = Math.PI / 24; // radians per press of an arrow key
const ROOM = 1.12; // size of the view over the size of the piece: margin around it
const GHOST = 0.2; // opacity of the target's surface
// Names of renderers without a graphics card. Antialiasing takes two thirds of a frame's time there; drawing at LARGER times the
// resolution, which the browser scales down, takes much less
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const LARGER = 1.5;

/**
 * Create the WebGL context that three.js will use; return false without WebGL. Without a graphics card, replace the canvas by one whose
 * context has no antialiasing.
 * @param {HTMLCanvasElement} canvas
 */
function prepared(canvas) {
  const asked = { antialias: true, alpha: true, stencil: false };
  const gl = canvas.getContext("webgl2", asked);
  if (!gl) return false;
  // some browsers name the renderer in RENDERER, others only through this extension
  const named = /webkit webgl/i.test(gl.getParameter(gl.RENDERER)) ? gl.getExtension("WEBGL_debug_renderer_info") : null;
  if (!SOFTWARE.test(gl.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : gl.RENDERER))) return true;
  const plain = /** @type {HTMLCanvasElement} */ (canvas.cloneNode());
  if (plain.getContext("webgl2", { ...asked, antialias: false })) {
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    canvas.replaceWith(plain);
  }
  return true;
}

class View3D {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLElement} labels  parent of the texts over the picture
   * @param {Skin} skin
   */
  constructor(canvas, labels, skin) {
    this.canvas = canvas;
    this.labels = labels;
    this.skin = skin;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    const smoothed = this.renderer.getContext().getContextAttributes()?.antialias;
    this.renderer.setPixelRatio(Math.min(Math.max(window.devicePixelRatio, smoothed ? 1 : LARGER), 2));
    this.renderer.sortObjects = false; // the few objects are in order; sorting would compute their bounds in every frame
    this.camera = new THREE.PerspectiveCamera(32, 1, 1, 1e5);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(...FROM);
    this.scene = new THREE.Scene();
    this.scene.add(this.camera, new THREE.HemisphereLight(0xffffff, 0xaeb6c0, 2.3));
    const light = new THREE.DirectionalLight(0xffffff, 1.9);
    light.position.set(-0.5, 0.9, 0.6); // over the left shoulder
    this.camera.add(light);
    this.addPanels();
    this.addTarget();
    this.controls = new THREE.OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.ask());
    canvas.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    /** @type {{element: HTMLElement, place: () => {at: THREE.Vector3, normal: THREE.Vector3 | null}, always: boolean}[]} */
    this.texts = [];
    this.asked = false;
    this.steps = 0; // see `update`
    this.away = 0; // distance of the camera from the centre at which everything fits into the view
    this.size = ""; // width and height of the canvas, in CSS pixels
  }

  /** @private */
  addPanels() {
    const { corners, ends } = this.skin.triangles();
    this.ends = ends;
    this.geometry = new THREE.BufferGeometry();
    this.geometry.setIndex(new THREE.BufferAttribute(corners, 1));
    this.position = new THREE.BufferAttribute(this.skin.positions, 3);
    this.colour = new THREE.BufferAttribute(new Uint8Array(this.skin.positions.length), 3, true);
    this.geometry.setAttribute("position", this.position);
    this.geometry.setAttribute("color", this.colour);
    this.panels = new THREE.Mesh(this.geometry, new THREE.MeshLambertMaterial({ vertexColors: true, flatShading: true }));
    this.panels.frustumCulled = false; // the geometry moves, so its cached bounds would be wrong
    this.scene.add(this.panels);
  }

  /** Add the target as a translucent surface with the edges of its quads. @private */
  addTarget() {
    const { target, quads } = this.skin.arrays;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(target, 3));
    const faces = [];
    const lines = [];
    const seen = new Set();
    for (let i = 0; i < quads.length; i += 4) {
      const q = quads.subarray(i, i + 4);
      faces.push(q[0], q[1], q[2], q[0], q[2], q[3]);
      for (let k = 0; k < 4; k++) {
        const [a, b] = [Math.min(q[k], q[(k + 1) % 4]), Math.max(q[k], q[(k + 1) % 4])];
        const name = a * target.length + b;
        if (!seen.has(name)) lines.push(a, b);
        seen.add(name);
      }
    }
    geometry.setIndex(faces);
    const edges = new THREE.BufferGeometry();
    edges.setAttribute("position", geometry.getAttribute("position"));
    edges.setIndex(lines);
    const look = { color: 0x7c8794, transparent: true, depthWrite: false };
    this.target = new THREE.Group();
    this.target.add(new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ ...look, opacity: GHOST, side: THREE.DoubleSide })));
    this.target.add(new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ ...look, opacity: 2 * GHOST })));
    this.target.visible = false;
    this.scene.add(this.target);
  }

  /**
   * Colour the spirals.
   * @param {(quad: number) => THREE.Color} colourOf
   */
  paint(colourOf) {
    const skin = this.skin;
    const bytes = this.colour.array;
    for (let quad = 0; quad < skin.quads; quad++) {
      const rgb = colourOf(quad).toArray().map((x) => Math.round(255 * x));
      const fill = (from, to) => {
        for (let i = from; i < to; i++) bytes[i] = rgb[i % 3];
      };
      fill(12 * skin.first[4 * quad], 12 * skin.first[4 * quad + 4]);
      fill(12 * skin.sections + 6 * quad, 12 * skin.sections + 6 * quad + 6);
      const rim = 12 * skin.sections + 6 * skin.quads;
      fill(rim + 6 * skin.rimPoints[quad], rim + 6 * skin.rimPoints[quad + 1]);
    }
    this.colour.needsUpdate = true;
    this.ask();
  }

  /** Update geometry and camera after hubs have moved. @param {number} steps  show the panels of this many steps; 0 shows all */
  update(steps) {
    this.steps = steps;
    this.skin.draw();
    this.position.needsUpdate = true;
    this.geometry.setDrawRange(0, steps ? this.ends[steps - 1] : Infinity);
    this.look(steps);
    this.ask();
  }

  /** Move the camera so that all visible panels fit, keeping its direction and the user's zoom. @private @param {number} steps */
  look(steps) {
    const zoom = this.away ? this.camera.position.distanceTo(this.controls.target) / this.away : 1;
    const back = this.camera.position.clone().sub(this.controls.target).normalize();
    const right = new THREE.Vector3().crossVectors(this.camera.up, back).normalize();
    const up = new THREE.Vector3().crossVectors(back, right);
    const points = this.points(steps);
    // find the centre of the bounding box in the camera's axes, then the distance at which everything fits
    const middle = new THREE.Vector3();
    for (const axis of [right, up, back]) {
      let [low, high] = [Infinity, -Infinity];
      for (let i = 0; i < points.length; i += 4) {
        const at = axis.x * points[i] + axis.y * points[i + 1] + axis.z * points[i + 2];
        low = Math.min(low, at - points[i + 3]);
        high = Math.max(high, at + points[i + 3]);
      }
      middle.addScaledVector(axis, 0.5 * (low + high));
    }
    const tall = Math.tan((Math.PI * this.camera.fov) / 360);
    const wide = tall * this.camera.aspect;
    let away = this.skin.piece.edge;
    const point = new THREE.Vector3();
    for (let i = 0; i < points.length; i += 4) {
      point.fromArray(points, i).sub(middle);
      const rim = points[i + 3];
      const beside = Math.max((Math.abs(point.dot(right)) + rim) / wide, (Math.abs(point.dot(up)) + rim) / tall);
      away = Math.max(away, point.dot(back) + ROOM * beside);
    }
    this.away = away;
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).addScaledVector(back, away * zoom);
    this.camera.near = away / 100;
    this.camera.far = 20 * away;
    this.camera.updateProjectionMatrix();
    this.controls.minDistance = 0.05 * away;
    this.controls.maxDistance = 6 * away;
    this.controls.update();
  }

  /**
   * Return spheres that must fit into the view, x, y, z, radius each: a sphere about each visible hub that encloses its arms, and the
   * target's vertices if it is shown.
   * @private @param {number} steps @returns {number[]}
   */
  points(steps) {
    const { centres, shifts, rims, quads, arrays, piece } = this.skin;
    const found = [];
    for (let quad = 0; quad < quads; quad++) {
      const panel = arrays.patch[quad];
      if (steps && piece.panels[panel].step >= steps) continue;
      for (let k = 0; k < 3; k++) found.push(centres[3 * quad + k] + shifts[3 * panel + k]);
      found.push(rims[quad]);
    }
    if (this.target.visible) {
      const { target } = arrays;
      for (let i = 0; i < target.length; i += 3) found.push(target[i], target[i + 1], target[i + 2], 0);
    }
    return found;
  }

  /** Restore the first view. */
  home() {
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(...FROM).setLength(this.away));
    this.look(this.steps);
    this.ask();
  }

  /** Turn the camera towards a direction, by a share (0 to 1) of the way. @param {THREE.Vector3} way @param {number} share */
  turnTo(way, share) {
    const away = this.camera.position.clone().sub(this.controls.target);
    const length = away.length();
    away.normalize().lerp(way.clone().normalize(), share);
    if (Math.hypot(away.x, away.y) < 1e-3 || away.length() < 0.1) away.y -= 0.1; // avoid the poles and the centre
    this.camera.position.copy(this.controls.target).add(away.setLength(length));
    this.controls.update();
  }

  /** Orbit, zoom or reset the view by a key. @private @param {KeyboardEvent} event */
  key(event) {
    const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const zooms = { "+": 0.87, "=": 0.87, "-": 1.15 };
    const [target, position] = [this.controls.target, this.camera.position];
    const away = position.clone().sub(target);
    if (event.key in turns) {
      const [about, over] = turns[event.key];
      const flat = Math.hypot(away.x, away.y);
      const height = Math.min(Math.max(Math.atan2(away.z, flat) - over * TURN_KEY, -1.5), 1.5);
      const angle = Math.atan2(away.y, away.x) - about * TURN_KEY;
      const length = away.length();
      away.set(Math.cos(height) * Math.cos(angle), Math.cos(height) * Math.sin(angle), Math.sin(height)).multiplyScalar(length);
    } else if (event.key in zooms) {
      away.multiplyScalar(zooms[event.key]);
    } else if (event.key === "Home") {
      this.home();
      return;
    } else {
      return;
    }
    event.preventDefault();
    position.copy(target).add(away);
    this.controls.update();
    this.ask();
  }

  /** Fit the canvas to its parent element if that has changed its size. */
  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    const size = `${box.width} ${box.height}`;
    if (!box.width || !box.height || size === this.size) return;
    this.size = size;
    this.renderer.setSize(box.width, box.height, false);
    this.camera.aspect = box.width / box.height;
    this.camera.updateProjectionMatrix();
    if (this.away) this.look(this.steps);
    this.ask();
  }

  /** Request a frame, unless one is requested already. */
  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.resize(); // the ResizeObserver would report after this frame and cause another one
      this.asked = false;
      this.render();
    });
  }

  render() {
    this.renderer.render(this.scene, this.camera);
    this.placeTexts();
  }

  // -- texts over the picture --------------------------------------------------------------------------------------------

  /**
   * Set the labels; `place` gives a label's present position and normal.
   * @param {{text: string, name: string, colour: string | null, always: boolean,
   *          place: () => {at: THREE.Vector3, normal: THREE.Vector3 | null}}[]} texts
   */
  setTexts(texts) {
    this.labels.replaceChildren();
    this.texts = texts.map(({ text, name, colour, always, place }) => {
      const element = document.createElement("span");
      element.textContent = text;
      element.className = name;
      if (colour) element.style.setProperty("--own", colour);
      this.labels.append(element);
      return { element, place, always };
    });
    this.ask();
  }

  /** Place the labels; hide those that would overlap an earlier one. @private */
  placeTexts() {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const taken = [];
    for (const { element, place, always } of this.texts) {
      const { at, normal } = place();
      const away = normal ? normal.dot(this.camera.position.clone().sub(at)) < 0 : false;
      at.project(this.camera);
      const [x, y] = [0.5 * width * (1 + at.x), 0.5 * height * (1 - at.y)];
      const room = 9 + 3.6 * (element.textContent ?? "").length;
      const hidden = at.z > 1 || (!always && taken.some(([a, b, r]) => Math.abs(a - x) < room + r && Math.abs(b - y) < 20));
      if (!hidden) taken.push([x, y, room]);
      element.hidden = hidden;
      element.classList.toggle("behind", away);
      element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
    }
  }

  /** Return the present position and normal of a hub. @param {number} quad */
  hub(quad) {
    const skin = this.skin;
    const panel = skin.arrays.patch[quad];
    const at = new THREE.Vector3().fromArray(skin.centres, 3 * quad).add(new THREE.Vector3().fromArray(skin.shifts, 3 * panel));
    const turn = new THREE.Quaternion().fromArray(skin.turns, 4 * quad);
    return { at, normal: new THREE.Vector3(0, 0, 1).applyQuaternion(turn) };
  }

  /** Return the present position and normal of an arm's tip. @param {number} arm */
  tip(arm) {
    const at = new THREE.Vector3().fromArray(this.skin.tipAt(arm, new Float32Array(3), 1));
    return { at, normal: this.hub(arm >> 2).normal };
  }

  // -- pictures ----------------------------------------------------------------------------------------------------------

  /** Draw the present view with its background and labels as a PNG picture. @returns {Promise<Blob>} */
  picture() {
    this.render();
    const out = document.createElement("canvas");
    [out.width, out.height] = [this.canvas.width, this.canvas.height];
    const scale = out.width / this.canvas.clientWidth;
    const pen = /** @type {CanvasRenderingContext2D} */ (out.getContext("2d"));
    pen.fillStyle = getComputedStyle(this.canvas.parentElement).backgroundColor;
    pen.fillRect(0, 0, out.width, out.height);
    pen.drawImage(this.canvas, 0, 0);
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    for (const { element } of this.texts) {
      if (element.hidden || element.classList.contains("behind")) continue;
      const style = getComputedStyle(element);
      const box = element.getBoundingClientRect();
      const from = this.canvas.getBoundingClientRect();
      const [x, y] = [scale * (box.left - from.left), scale * (box.top - from.top)];
      pen.fillStyle = style.backgroundColor;
      pen.beginPath();
      pen.roundRect(x, y, scale * box.width, scale * box.height, 6 * scale);
      pen.fill();
      pen.font = `${style.fontWeight} ${scale * parseFloat(style.fontSize)}px ${style.fontFamily}`;
      pen.fillStyle = style.color;
      pen.fillText(element.textContent ?? "", x + 0.5 * scale * box.width, y + 0.5 * scale * box.height);
    }
    return new Promise((resolve) => out.toBlob((blob) => resolve(/** @type {Blob} */ (blob)), "image/png"));
  }
}
