// Positions of everything at a time: hubs follow the film, arms follow their hubs. Port of `skin.py`; lengths in millimetres.

/**
 * @typedef {Object} Track  Motion of one panel; times in steps of the assembly.
 * @property {number} panel
 * @property {number[]} changes  times of the shapes `which`
 * @property {number[]} which  index of the panel's shape at each of these times
 * @property {number[]} times  times of `turns` and `places`
 * @property {number[][]} turns  rotations of the panel's frame: quaternions x, y, z, w
 * @property {number[][]} places  positions of the panel's frame
 *
 * @typedef {Object} Piece  Data written by `page_data.py`.
 * @property {string} title
 * @property {boolean} simulated
 * @property {number} thickness
 * @property {number} edge
 * @property {number} length  duration of the film, in steps
 * @property {{name: string, colour: string, hub: number, step: number}[]} panels
 * @property {{name: string, colour: string, other: string | null, joints: [number, string][]}[][]} seams  closed in each step
 * @property {{name: string, label: string, unit: string, low: number, high: number, scale: string[]}[]} colourings
 * @property {Track[]} tracks
 * @property {string[]} notes
 * @property {Object<string, Listed>} arrays
 * @property {string} block
 */

/** Return the first column of an array with `columns` columns. @param {number} columns @param {ArrayLike<number>} [numbers] */
function every(columns, numbers) {
  return Array.from({ length: numbers ? numbers.length / columns : 0 }, (_, i) => numbers[columns * i]);
}

/** Return where each quad's rows begin, in rows sorted by quad; `of` gives the quad of a row. @param {ArrayLike<number>} rows @param {number} quads @param {(row: number) => number} of */
function firsts(rows, quads, of) {
  const out = new Int32Array(quads + 1);
  for (let i = 0; i < rows.length; i++) out[of(rows[i]) + 1] += 1;
  for (let quad = 0; quad < quads; quad++) out[quad + 1] += out[quad];
  return out;
}

class Skin {
  /**
   * @param {Piece} piece
   * @param {Arrays} arrays
   */
  constructor(piece, arrays) {
    this.piece = piece;
    this.arrays = arrays;
    this.quads = arrays.patch.length;
    this.arms = 4 * this.quads;
    this.sections = arrays.share.length;
    /** Present centres and quaternions of the hubs. */
    this.centres = new Float32Array(3 * this.quads);
    this.turns = new Float32Array(4 * this.quads);
    /** Motion of each tip relative to its hub: displacement, then rotation vector; `full` is the motion in the final pose. */
    this.moved = new Float32Array(6 * this.arms);
    this.full = new Float32Array(6 * this.arms);
    /** 1 for arms with a joint; the others, at a border, bend as much as the mean of their spiral's arms with joints. */
    this.met = new Uint8Array(this.arms);
    for (const arm of arrays.joints) this.met[arm] = 1;
    this.bends = new Float32Array(this.arms);
    const rim = arrays.rim_quad || [];
    this.rimPoints = firsts(rim, this.quads, (quad) => quad);
    this.rimTriangles = firsts(every(3, arrays.rim_triangles), this.quads, (point) => rim[point]);
    this.rimWalls = firsts(every(2, arrays.rim_walls), this.quads, (point) => rim[point]);
    /**
     * Vertices: four corners of every section (left and right above, left and right below), then two for every hub's centre (above and
     * below), then two for every point of the rim.
     */
    this.positions = new Float32Array(12 * this.sections + 6 * this.quads + 6 * rim.length);
    /** @type {number[][]} hubs of every panel */
    this.hubs = piece.panels.map(() => []);
    for (let quad = 0; quad < this.quads; quad++) this.hubs[arrays.patch[quad]].push(quad);
    this.first = new Int32Array(this.arms + 1);
    for (let arm = 0; arm < this.arms; arm++) this.first[arm + 1] = this.first[arm] + arrays.sections[arm];
    /** Distance from every hub to its farthest tip, in the flat panel. */
    this.rims = new Float32Array(this.quads);
    for (let arm = 0; arm < this.arms; arm++) {
      const reach = Math.hypot(arrays.tip[2 * arm], arrays.tip[2 * arm + 1]);
      this.rims[arm >> 2] = Math.max(this.rims[arm >> 2], reach);
    }
    this.shifts = new Float32Array(3 * piece.panels.length);
    this.pull(piece.length, 0);
    this.full.set(this.moved);
    /** Vector from the centre of the piece to the centre of each panel in the final pose. */
    this.outwards = this.ways();
  }

  /**
   * Move hubs and tips to their positions at a time.
   * @param {number} time  in steps
   * @param {number} apart  how far the panels are exploded, from 0 to 1
   */
  pull(time, apart) {
    for (const track of this.piece.tracks) this.placePanel(track, time);
    this.moveTips(time);
    for (let i = 0; i < this.shifts.length; i++) this.shifts[i] = apart ? apart * this.outwards[i] : 0;
  }

  /** Move the hubs of one panel. @private @param {Track} track @param {number} time */
  placePanel(track, time) {
    const [one, two, way] = bracket(track.changes, time);
    const hubs = this.hubs[track.panel];
    const centres = this.arrays[`centres ${track.panel}`];
    const turns = this.arrays[`turns ${track.panel}`];
    const first = track.which[one] * hubs.length;
    const second = track.which[two] * hubs.length;
    const [from, to, share] = bracket(track.times, time);
    const whole = mixedTurn(track.turns[from], 0, track.turns[to], 0, share, new Float32Array(4), 0);
    const place = [0, 1, 2].map((k) => (1 - share) * track.places[from][k] + share * track.places[to][k]);
    const own = new Float32Array(4);
    const point = new Float32Array(3);
    for (let i = 0; i < hubs.length; i++) {
      for (let k = 0; k < 3; k++) {
        point[k] = (1 - way) * centres[3 * (first + i) + k] + way * centres[3 * (second + i) + k];
      }
      turned(whole, 0, point);
      for (let k = 0; k < 3; k++) this.centres[3 * hubs[i] + k] = place[k] + point[k];
      mixedTurn(turns, 4 * (first + i), turns, 4 * (second + i), way, own, 0);
      product(whole, own, this.turns, 4 * hubs[i]);
    }
  }

  /** Move the two tips of each closed joint half way to each other. @private @param {number} time */
  moveTips(time) {
    const { joints, closings, axis } = this.arrays;
    const ends = [new Float32Array(3), new Float32Array(3)];
    const frames = [new Float32Array(4), new Float32Array(4)];
    const across = new Float32Array(4);
    const vector = new Float32Array(3);
    for (let joint = 0; joint < joints.length / 2; joint++) {
      const begin = closings ? closings[2 * joint] : 0;
      const closed = closings ? 0.5 * smooth((time - begin) / (closings[2 * joint + 1] - begin)) : 0;
      for (let side = 0; side < 2; side++) {
        const arm = joints[2 * joint + side];
        this.tipAt(arm, ends[side], 0);
        aboutZ(this.turns, arm & ~3, axis[arm], frames[side]);
      }
      for (let side = 0; side < 2; side++) {
        const arm = joints[2 * joint + side];
        for (let k = 0; k < 3; k++) vector[k] = closed * (ends[1 - side][k] - ends[side][k]);
        turnedBack(this.turns, arm & ~3, vector);
        this.moved.set(vector, 6 * arm);
        between(frames[side], frames[1 - side], across);
        rotationVector(across, vector);
        const cosine = Math.cos(axis[arm]);
        const sine = Math.sin(axis[arm]);
        this.moved[6 * arm + 3] = closed * (cosine * vector[0] - sine * vector[1]);
        this.moved[6 * arm + 4] = closed * (sine * vector[0] + cosine * vector[1]);
        this.moved[6 * arm + 5] = closed * vector[2];
      }
    }
  }

  /**
   * Compute the position of an arm's tip: rigidly fixed to its hub if `share` is 0; moved by its joint and the explosion if it is 1.
   * @param {number} arm @param {Float32Array} out @param {0 | 1} share
   */
  tipAt(arm, out, share) {
    const quad = arm >> 2;
    for (let k = 0; k < 3; k++) out[k] = (k < 2 ? this.arrays.tip[2 * arm + k] : 0) + share * this.moved[6 * arm + k];
    turned(this.turns, 4 * quad, out);
    for (let k = 0; k < 3; k++) {
      out[k] += this.centres[3 * quad + k] + share * this.shifts[3 * this.arrays.patch[quad] + k];
    }
    return out;
  }

  /** Compute all vertices (`positions`) from hubs and tips. */
  draw() {
    const { patch } = this.arrays;
    const hub = new Float32Array(9);
    const bent = new Float32Array(9);
    for (let quad = 0; quad < this.quads; quad++) {
      const shift = 3 * patch[quad];
      const x = this.centres[3 * quad] + this.shifts[shift];
      const y = this.centres[3 * quad + 1] + this.shifts[shift + 1];
      const z = this.centres[3 * quad + 2] + this.shifts[shift + 2];
      matrixOf(this.turns, 4 * quad, hub);
      this.drawHub(quad, hub, x, y, z);
      this.drawRim(quad, hub, x, y, z, this.bend(quad));
      for (let arm = 4 * quad; arm < 4 * quad + 4; arm++) this.drawArm(arm, hub, bent, x, y, z);
    }
    return this.positions;
  }

  /**
   * Compute the corners of an arm's sections. It runs hundreds of thousands of times a second, so it allocates nothing.
   * @private @param {number} arm @param {Float32Array} hub  the hub's matrix @param {Float32Array} m  buffer for a matrix
   * @param {number} cx @param {number} cy @param {number} cz
   */
  drawArm(arm, hub, m, cx, cy, cz) {
    const { tip, flat, share, way, turn } = this.arrays;
    const out = this.positions;
    const half = 0.5 * this.piece.thickness;
    const at = 6 * arm;
    const mx = this.moved[at];
    const my = this.moved[at + 1];
    const mz = this.moved[at + 2];
    const ax = this.moved[at + 3];
    const ay = this.moved[at + 4];
    const az = this.moved[at + 5];
    exponential(ax, ay, az, m);
    const e0 = m[0];
    const e1 = m[1];
    const e3 = m[3];
    const e4 = m[4];
    const e6 = m[6];
    const e7 = m[7];
    const bend = this.bends[arm];
    const tx = tip[2 * arm];
    const ty = tip[2 * arm + 1];
    for (let s = this.first[arm]; s < this.first[arm + 1]; s++) {
      const w = share[s];
      const px = 0.5 * (flat[4 * s] + flat[4 * s + 2]);
      const py = 0.5 * (flat[4 * s + 1] + flat[4 * s + 3]);
      const dx = px - tx;
      const dy = py - ty;
      // centre of the section in the hub's frame: blend of following the hub and following the tip, plus the stored correction
      const x = (1 - w) * px + w * (tx + mx + e0 * dx + e1 * dy) + bend * way[3 * s];
      const y = (1 - w) * py + w * (ty + my + e3 * dx + e4 * dy) + bend * way[3 * s + 1];
      const z = w * (mz + e6 * dx + e7 * dy) + bend * way[3 * s + 2];
      exponential(w * ax + bend * turn[3 * s], w * ay + bend * turn[3 * s + 1], w * az + bend * turn[3 * s + 2], m);
      const hx = 0.5 * (flat[4 * s] - flat[4 * s + 2]);
      const hy = 0.5 * (flat[4 * s + 1] - flat[4 * s + 3]);
      const sx = m[0] * hx + m[1] * hy;
      const sy = m[3] * hx + m[4] * hy;
      const sz = m[6] * hx + m[7] * hy;
      for (let corner = 0; corner < 4; corner++) {
        const side = corner % 2 ? -1 : 1;
        const up = corner < 2 ? half : -half;
        const qx = x + side * sx + up * m[2];
        const qy = y + side * sy + up * m[5];
        const qz = z + side * sz + up * m[8];
        const to = 12 * s + 3 * corner;
        out[to] = cx + hub[0] * qx + hub[1] * qy + hub[2] * qz;
        out[to + 1] = cy + hub[3] * qx + hub[4] * qy + hub[5] * qz;
        out[to + 2] = cz + hub[6] * qx + hub[7] * qy + hub[8] * qz;
      }
    }
  }

  /** Compute a hub's two vertices. @private */
  drawHub(quad, hub, cx, cy, cz) {
    for (let side = 0; side < 2; side++) {
      const at = 12 * this.sections + 6 * quad + 3 * side;
      const up = (0.5 - side) * this.piece.thickness;
      this.positions[at] = cx + up * hub[2];
      this.positions[at + 1] = cy + up * hub[5];
      this.positions[at + 2] = cz + up * hub[8];
    }
  }

  /** Store in `bends` how much the arms of a spiral are bent (0 to 1); return the mean of the arms with joints. @private @param {number} quad */
  bend(quad) {
    let [sum, count] = [0, 0];
    for (let arm = 4 * quad; arm < 4 * quad + 4; arm++) {
      if (!this.met[arm]) continue;
      this.bends[arm] = this.measure(arm);
      sum += this.bends[arm];
      count += 1;
    }
    const mean = sum / Math.max(count, 1);
    for (let arm = 4 * quad; arm < 4 * quad + 4; arm++) if (!this.met[arm]) this.bends[arm] = mean;
    return mean;
  }

  /** Compute the vertices of a spiral's rim. @private @param {number} quad @param {Float32Array} hub @param {number} cx @param {number} cy @param {number} cz @param {number} bend */
  drawRim(quad, hub, cx, cy, cz, bend) {
    const { rim_flat, rim_way, rim_up } = this.arrays;
    for (let p = this.rimPoints[quad]; p < this.rimPoints[quad + 1]; p++) {
      const ux = bend * rim_up[3 * p];
      const uy = bend * rim_up[3 * p + 1];
      const uz = 1 - bend + bend * rim_up[3 * p + 2];
      const lift = (0.5 * this.piece.thickness) / Math.hypot(ux, uy, uz);
      for (let side = 0; side < 2; side++) {
        const up = side ? -lift : lift;
        const qx = rim_flat[2 * p] + bend * rim_way[3 * p] + up * ux;
        const qy = rim_flat[2 * p + 1] + bend * rim_way[3 * p + 1] + up * uy;
        const qz = bend * rim_way[3 * p + 2] + up * uz;
        const to = 12 * this.sections + 6 * this.quads + 6 * p + 3 * side;
        this.positions[to] = cx + hub[0] * qx + hub[1] * qy + hub[2] * qz;
        this.positions[to + 1] = cy + hub[3] * qx + hub[4] * qy + hub[5] * qz;
        this.positions[to + 2] = cz + hub[6] * qx + hub[7] * qy + hub[8] * qz;
      }
    }
  }

  /** Return an arm's present bend as a share (0 to 1) of its final bend. @private @param {number} arm */
  measure(arm) {
    const size = Math.hypot(this.arrays.tip[2 * arm], this.arrays.tip[2 * arm + 1]);
    let [both, all] = [0, 0];
    for (let k = 0; k < 6; k++) {
      const unit = k < 3 ? 1 / (size * size) : 1;
      both += this.moved[6 * arm + k] * this.full[6 * arm + k] * unit;
      all += this.full[6 * arm + k] * this.full[6 * arm + k] * unit;
    }
    return Math.min(Math.max(both / Math.max(all, 1e-12), 0), 1);
  }

  /** Return the vectors from the centre of the piece to the centres of the panels. @private */
  ways() {
    const out = new Float32Array(3 * this.hubs.length);
    const middle = [0, 0, 0];
    for (let i = 0; i < this.centres.length; i++) middle[i % 3] += this.centres[i] / this.quads;
    this.hubs.forEach((hubs, panel) => {
      for (const hub of hubs) for (let k = 0; k < 3; k++) out[3 * panel + k] += this.centres[3 * hub + k] / hubs.length;
      for (let k = 0; k < 3; k++) out[3 * panel + k] -= middle[k];
    });
    return out;
  }

  /**
   * Return the triangles of all panels in order of assembly, and after each step the number of corners up to its panel.
   * @returns {{corners: Uint32Array, ends: number[]}}
   */
  triangles() {
    const { panels } = this.piece;
    const { rim_triangles, rim_walls } = this.arrays;
    const rim = rim_triangles ? 2 * rim_triangles.length + 3 * rim_walls.length : 0;
    const corners = new Uint32Array(24 * this.sections + rim);
    const ends = [];
    let at = 0;
    for (const panel of panels.map((_, i) => i).sort((a, b) => panels[a].step - panels[b].step)) {
      for (const quad of this.hubs[panel]) at = this.trianglesOf(quad, corners, at);
      ends.push(at);
    }
    return { corners, ends };
  }

  /** Write a spiral's triangles at offset `at`; return the offset after them. @private @param {number} quad @param {Uint32Array} out @param {number} at */
  trianglesOf(quad, out, at) {
    const middle = 4 * this.sections + 2 * quad;
    const triangle = (a, b, c) => {
      out[at++] = a;
      out[at++] = b;
      out[at++] = c;
    };
    const face = (a, b, c, d) => {
      triangle(a, b, c);
      triangle(a, c, d);
    };
    for (let arm = 4 * quad; arm < 4 * quad + 4; arm++) {
      const begin = 4 * this.first[arm];
      const last = 4 * (this.first[arm + 1] - 1);
      for (let a = begin; a < last; a += 4) {
        const b = a + 4;
        face(a, b, b + 1, a + 1);
        face(a + 3, b + 3, b + 2, a + 2);
        face(b, a, a + 2, b + 2);
        face(a + 1, b + 1, b + 3, a + 3);
      }
      face(begin, begin + 1, begin + 3, begin + 2);
      // the hub, counter-clockwise: from the right of this arm's root to its left, then to the right of the next arm's root
      const next = arm % 4 < 3 ? arm + 1 : 4 * quad;
      const onward = 4 * (this.first[next + 1] - 1) + 1;
      triangle(middle, last + 1, last);
      triangle(middle, last, onward);
      triangle(middle + 1, last + 2, last + 3);
      triangle(middle + 1, onward + 2, last + 2);
      face(last + 2, onward + 2, onward, last);
    }
    const rim = 4 * this.sections + 2 * this.quads; // vertices alternate above and below
    const { rim_triangles: t, rim_walls: w } = this.arrays;
    for (let k = this.rimTriangles[quad]; k < this.rimTriangles[quad + 1]; k++) {
      const [a, b, c] = [3 * k, 3 * k + 1, 3 * k + 2].map((i) => rim + 2 * t[i]);
      triangle(a, b, c);
      triangle(c + 1, b + 1, a + 1);
    }
    for (let k = this.rimWalls[quad]; k < this.rimWalls[quad + 1]; k++) {
      const [a, b] = [rim + 2 * w[2 * k], rim + 2 * w[2 * k + 1]];
      face(a + 1, b + 1, b, a);
    }
    return at;
  }
}
