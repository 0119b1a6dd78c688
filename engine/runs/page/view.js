// Controls beside the 3D view: the slider from flat to assembled, colours, and the step-by-step assembly guide.

const STEP = 1.5; // duration of a panel's flight and joining, in steps (`FLIGHT` + `CLOSING` of film.py)
const SECONDS = 1.1; // seconds per step when the film plays
const FACING = 0.8; // seconds in which the camera turns to a panel
const LIT = "#f59e0b"; // colour of the step's panel in the guide
const PALE = "#aeb6c0"; // colour of the panels of earlier steps

class Page {
  /**
   * @param {HTMLElement} root
   * @param {Piece} piece
   * @param {Arrays} arrays
   */
  constructor(root, piece, arrays) {
    this.root = root;
    this.piece = piece;
    this.skin = new Skin(piece, arrays);
    this.view = new View3D(this.find("canvas"), this.find(".labels"), this.skin);
    this.time = piece.length;
    this.apart = 0;
    /** Present step of the assembly guide, from 0; null outside the guide. @type {number | null} */
    this.step = null;
    this.playing = 0;
    this.connect();
    this.view.resize(); // only now: the controls beside the canvas affect its size
    this.follow();
  }

  /** Return an element of the view; null if it exists only for simulated pieces and this one is not. @template {HTMLElement} T @param {string} selector @returns {T} */
  find(selector) {
    return /** @type {T} */ (this.root.querySelector(selector));
  }

  /** Connect the controls, and remove those that don't apply to this piece. @private */
  connect() {
    const { piece } = this;
    const way = /** @type {HTMLInputElement} */ (this.find("[name=way]"));
    way.max = String(piece.length);
    way.addEventListener("input", () => {
      this.stop();
      this.show(Number(way.value));
    });
    this.find("[name=apart]").addEventListener("input", (event) => {
      this.apart = Number(/** @type {HTMLInputElement} */ (event.target).value);
      this.show(this.time);
    });
    this.find("[name=play]").addEventListener("click", () => this.play());
    this.find("[name=target]").addEventListener("change", () => this.options());
    this.find("[name=numbers]").addEventListener("change", () => this.options());
    this.find("[name=picture]").addEventListener("click", () => this.save());
    this.find("[name=home]").addEventListener("click", () => this.view.home());
    this.addColourings();
    const steps = piece.seams.length;
    const go = (step) => (location.hash = `step=${Math.min(Math.max(step, 1), steps)}`);
    this.find("[name=next]").addEventListener("click", () => go((this.step ?? -1) + 2));
    this.find("[name=previous]").addEventListener("click", () => go(this.step ?? 1));
    this.find("[name=again]").addEventListener("click", () => this.playStep());
    this.find("[name=whole]").addEventListener("click", () => (location.hash = "view"));
    this.find("[name=guide]").addEventListener("click", () => go(this.last ?? 1));
    window.addEventListener("hashchange", () => this.follow());
    this.find("canvas").addEventListener("keydown", (event) => {
      const key = /** @type {KeyboardEvent} */ (event).key;
      if (key === "n" && this.step !== null) go(this.step + 2);
      if (key === "p" && this.step !== null) go(this.step);
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.view.ask());
    if (!piece.simulated) {
      for (const each of this.root.querySelectorAll(".simulated")) each.remove();
      /** @type {HTMLInputElement} */ (this.find("[name=target]")).checked = true;
    } else {
      for (const each of this.root.querySelectorAll(".unsimulated")) each.remove();
    }
    this.find(".notes").textContent = piece.notes.join(" ");
    // on a page that scrolls, the wheel zooms only after a click on the view
    if (this.root.dataset.scrolls !== undefined) {
      this.view.controls.enableZoom = false;
      this.find("canvas").addEventListener("pointerdown", () => (this.view.controls.enableZoom = true));
      this.find("canvas").addEventListener("blur", () => (this.view.controls.enableZoom = false));
    }
  }

  /** Add a radio button per colouring. @private */
  addColourings() {
    const names = [{ name: "panel", label: "Panels" }, ...this.piece.colourings];
    const short = { distance: "Distance", strain: "Strain", stiffness: "Stiffness" };
    const box = this.find(".colourings");
    names.forEach(({ name, label }, i) => {
      const line = document.createElement("label");
      const input = document.createElement("input");
      Object.assign(input, { type: "radio", name: "colour", value: name, checked: i === 0 });
      input.addEventListener("change", () => this.options());
      const text = document.createElement("span");
      text.textContent = short[name] ?? label;
      line.append(input, text);
      box.append(line);
    });
  }

  // -- what is shown -----------------------------------------------------------------------------------------------------

  /** Set the mode from the address (#step=3), so that a reload returns to the same step. */
  follow() {
    const asked = /^#step=(\d+)$/.exec(location.hash);
    const steps = this.piece.seams.length;
    const guided = asked !== null && this.piece.simulated;
    this.stop();
    this.step = guided ? Math.min(Math.max(Number(asked[1]), 1), steps) - 1 : null;
    if (this.step !== null) this.last = this.step + 1;
    this.root.dataset.mode = guided ? "guide" : "view";
    for (const [name, on] of [["whole", !guided], ["guide", guided]]) {
      this.find(`[name=${name}]`)?.setAttribute("aria-pressed", String(on));
    }
    if (guided) {
      this.tell();
      this.playStep();
    } else {
      this.show(this.time);
    }
    this.options();
  }

  /** Show the piece at a time of the film. @param {number} time  in steps */
  show(time) {
    this.time = this.step === null ? time : this.time;
    const steps = this.step === null ? 0 : this.step + 1;
    this.shown = time;
    this.skin.pull(time, this.step === null ? this.apart * smooth(time / Math.max(this.piece.length, 1e-9)) : 0);
    this.view.update(steps);
    const way = /** @type {HTMLInputElement | null} */ (this.find("[name=way]"));
    if (way && this.step === null) way.value = String(time);
  }

  /** Apply the options for colours, target and labels. */
  options() {
    const checked = (name) => /** @type {HTMLInputElement | null} */ (this.root.querySelector(`[name=${name}]`))?.checked ?? false;
    const target = checked("target") && this.step === null;
    if (this.view.target.visible !== target) {
      this.view.target.visible = target;
      this.show(this.shown ?? this.time);
    }
    this.paint();
    const texts = checked("numbers") || this.step !== null ? this.numbers() : [];
    this.view.setTexts([...texts, ...this.letters()]);
  }

  /** Colour the panels by the option, or in the guide by whether they belong to the step. @private */
  paint() {
    const { panels, colourings } = this.piece;
    const patch = this.skin.arrays.patch;
    const name = /** @type {HTMLInputElement} */ (this.find("[name=colour]:checked")).value;
    const scale = colourings.find((each) => each.name === name);
    const step = this.step;
    this.legend(step === null ? scale : undefined);
    if (step !== null) {
      const [lit, pale] = [new THREE.Color(LIT), new THREE.Color(PALE)];
      this.view.paint((quad) => (panels[patch[quad]].step === step ? lit : pale));
    } else if (scale) {
      const colours = scale.scale.map((each) => new THREE.Color(each));
      const out = new THREE.Color();
      const values = this.skin.arrays[name];
      this.view.paint((quad) => onScale(colours, values[quad], out));
    } else {
      const colours = panels.map((each) => new THREE.Color(each.colour));
      this.view.paint((quad) => colours[patch[quad]]);
    }
  }

  /** Show the legend of a colour scale, or hide it. @private */
  legend(scale) {
    const box = this.find(".legend");
    box.hidden = scale === undefined;
    if (!scale) return;
    box.querySelector(".what").textContent = `${scale.label}, ${scale.unit}`;
    box.querySelector(".low").textContent = rounded(scale.low);
    box.querySelector(".high").textContent = rounded(scale.high);
    /** @type {HTMLElement} */ (box.querySelector(".bar")).style.background = `linear-gradient(to right, ${scale.scale.join(", ")})`;
  }

  /** Return the labels of the panels' numbers. @private */
  numbers() {
    return this.piece.panels
      .filter((panel) => this.step === null || panel.step <= this.step)
      .map((panel) => ({
        text: panel.name, name: this.step === panel.step ? "number lit" : "number", colour: null, always: true,
        place: () => this.view.hub(panel.hub),
      }));
  }

  /**
   * Return the labels of the joints that this step closes. The ends of seams come first: later labels are hidden if there is too little
   * space. @private
   */
  letters() {
    if (this.step === null) return [];
    const found = this.piece.seams[this.step].flatMap((seam) =>
      seam.joints.map(([arm, text], i) => ({
        text, name: "letter", colour: seam.colour, always: false, place: () => this.view.tip(arm),
        first: i === 0 || i === seam.joints.length - 1 ? 0 : 1,
      })),
    );
    return found.sort((a, b) => a.first - b.first);
  }

  // -- the guide ---------------------------------------------------------------------------------------------------------

  /** Describe the present step in the guide. @private */
  tell() {
    const step = /** @type {number} */ (this.step);
    const count = this.piece.seams.length;
    const panel = this.piece.panels.find((each) => each.step === step);
    const seams = this.piece.seams[step];
    const joined = seams.some((seam) => seam.other !== null);
    this.find(".count").textContent = `Step ${step + 1} of ${count}`;
    this.find(".do").textContent = `${joined ? "Add" : "Take"} panel ${panel?.name ?? ""}`;
    const list = this.find(".seams");
    list.replaceChildren(
      ...seams.map((seam) => {
        const line = document.createElement("li");
        const chip = document.createElement("b");
        chip.textContent = seam.name;
        chip.style.setProperty("--own", seam.colour);
        const joints = seam.joints.length === 1 ? "1 joint" : `${seam.joints.length} joints`;
        const names = seam.joints.length === 1 ? seam.joints[0][1] : `${seam.name}1 to ${seam.name}${seam.joints.length}`;
        const text = document.createElement("span");
        text.textContent = seam.other === null ? "within the panel" : `to panel ${seam.other}`;
        const small = document.createElement("small");
        small.textContent = `${joints}, ${names}`;
        text.append(small);
        line.append(chip, text);
        return line;
      }),
    );
    /** @type {HTMLProgressElement} */ (this.find("progress")).max = count;
    /** @type {HTMLProgressElement} */ (this.find("progress")).value = step + 1;
    /** @type {HTMLButtonElement} */ (this.find("[name=previous]")).disabled = step === 0;
    /** @type {HTMLButtonElement} */ (this.find("[name=next]")).disabled = step === count - 1;
  }

  // -- playing -----------------------------------------------------------------------------------------------------------

  stop() {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    this.find("[name=play]")?.setAttribute("aria-pressed", "false");
  }

  /** Play the film from the present time, or from the start if it has ended; stop it if it plays. */
  play() {
    if (this.playing) return this.stop();
    const from = this.time >= this.piece.length ? 0 : this.time;
    this.run(from, this.piece.length);
    this.find("[name=play]").setAttribute("aria-pressed", "true");
  }

  /** Play the present step: its panel flies to its place, seen from outside. */
  playStep() {
    const step = /** @type {number} */ (this.step);
    const end = Math.min(step + STEP, this.piece.length);
    this.skin.pull(end, 0);
    const hubs = this.skin.hubs[this.piece.panels.findIndex((panel) => panel.step === step)];
    const way = new THREE.Vector3();
    for (const hub of hubs) way.add(this.view.hub(hub).normal);
    way.normalize().add(new THREE.Vector3(0, 0, 0.35));
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.view.turnTo(way, 1);
      this.show(end);
    } else {
      this.run(step, end, way);
    }
  }

  /** Play the film between two times. @private @param {number} from @param {number} to @param {THREE.Vector3} [way]  direction to look from */
  run(from, to, way) {
    this.stop();
    const began = performance.now();
    let last = began;
    const tick = (now) => {
      const time = Math.min(from + Math.max(now - began, 0) / 1000 / SECONDS, to);
      // approach the direction exponentially, so that the turn soon gives way to the user's own dragging
      if (way && now - began < 1000 * FACING) this.view.turnTo(way, 1 - Math.exp((-5 * (now - last)) / (1000 * FACING)));
      last = now;
      this.show(time);
      if (time < to) this.playing = requestAnimationFrame(tick);
      else this.stop();
    };
    this.playing = requestAnimationFrame(tick);
  }

  /** Download the present view as a picture. @private */
  async save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await this.view.picture());
    link.download = `${this.piece.title || "piece"}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
}

/** Interpolate a colour scale. @param {THREE.Color[]} colours @param {number} value  from 0 to 1 @param {THREE.Color} out */
function onScale(colours, value, out) {
  const place = value * (colours.length - 1);
  const low = Math.min(Math.floor(place), colours.length - 2);
  // interpolate in sRGB, as the CSS gradient of the legend does
  const [one, two] = [colours[low].clone().convertLinearToSRGB(), colours[low + 1].clone().convertLinearToSRGB()];
  return out.copy(one.lerp(two, place - low)).convertSRGBToLinear();
}

/** Format a number with three digits. @param {number} value */
function rounded(value) {
  return value === 0 ? "0" : Number(value.toPrecision(3)).toString();
}

/** Start the view; without WebGL, show the pictures instead. In print the pictures are always shown. */
async function start() {
  const root = /** @type {HTMLElement} */ (document.getElementById("view"));
  const instead = /** @type {HTMLElement[]} */ ([...document.querySelectorAll(".instead")]);
  try {
    if (!prepared(/** @type {HTMLCanvasElement} */ (root.querySelector("canvas"))) || typeof DecompressionStream === "undefined") {
      throw new Error("no WebGL");
    }
    const piece = JSON.parse(/** @type {HTMLElement} */ (document.getElementById("piece")).textContent ?? "");
    const arrays = await unpacked(piece.arrays, piece.block);
    root.hidden = false;
    const page = new Page(root, piece, arrays);
    hook(page);
  } catch (error) {
    root.remove();
    for (const each of instead) each.classList.add("needed");
    if (!(error instanceof Error) || error.message !== "no WebGL") throw error;
  }
}

/**
 * Add `window.flexmaps` for tests and the console: `at(time)` shows the piece at a time; `hubs()` gives the centres of the hubs and
 * `corners()` all vertices, in millimetres.
 * @param {Page} page
 */
function hook(page) {
  Object.assign(window, {
    flexmaps: {
      length: page.piece.length,
      at: (time) => {
        page.stop();
        page.show(time);
      },
      hubs: () => Array.from(page.skin.centres),
      corners: () => Array.from(page.skin.positions),
      /** Draw a full frame and return its duration in milliseconds. */
      frame: () => {
        const began = performance.now();
        page.view.render();
        const gl = page.view.renderer.getContext();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        return performance.now() - began;
      },
      page,
    },
  });
}

start();
