// The controls beside the 3D view: the way from flat to assembled, colours, and the assembly step by step.

const STEP = 1.5; // how long a panel takes to fly and to be joined, in steps (`FLIGHT` + `CLOSING` of film.py)
const SECONDS = 1.1; // for one step of the film, as it plays
const FACING = 0.8; // seconds in which the view turns to a panel
const LIT = "#f59e0b"; // the panel that comes next
const PALE = "#aeb6c0"; // those that are there

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
    /** The step of the assembly guide that is shown, from 0 on; null outside of the guide. @type {number | null} */
    this.step = null;
    this.playing = 0;
    this.connect();
    this.view.resize(); // not before all that takes room beside it is there
    this.follow();
  }

  /** An element; what is only there for a simulated piece may be missing. @template {HTMLElement} T @param {string} selector @returns {T} */
  find(selector) {
    return /** @type {T} */ (this.root.querySelector(selector));
  }

  /** @private */
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
    // a page that scrolls goes on scrolling until the view was clicked
    if (this.root.dataset.scrolls !== undefined) {
      this.view.controls.enableZoom = false;
      this.find("canvas").addEventListener("pointerdown", () => (this.view.controls.enableZoom = true));
      this.find("canvas").addEventListener("blur", () => (this.view.controls.enableZoom = false));
    }
  }

  /** @private */
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

  /** Take the mode from the address, so that a reload goes on where the work was. */
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

  /** @param {number} time */
  show(time) {
    this.time = this.step === null ? time : this.time;
    const steps = this.step === null ? 0 : this.step + 1;
    this.shown = time;
    this.skin.pull(time, this.step === null ? this.apart * smooth(time / Math.max(this.piece.length, 1e-9)) : 0);
    this.view.update(steps);
    const way = /** @type {HTMLInputElement | null} */ (this.find("[name=way]"));
    if (way && this.step === null) way.value = String(time);
  }

  /** Colours, target and texts as they are asked for. */
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

  /** @private */
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

  /** @private */
  legend(scale) {
    const box = this.find(".legend");
    box.hidden = scale === undefined;
    if (!scale) return;
    box.querySelector(".what").textContent = `${scale.label}, ${scale.unit}`;
    box.querySelector(".low").textContent = rounded(scale.low);
    box.querySelector(".high").textContent = rounded(scale.high);
    /** @type {HTMLElement} */ (box.querySelector(".bar")).style.background = `linear-gradient(to right, ${scale.scale.join(", ")})`;
  }

  /** The panels' numbers. @private */
  numbers() {
    return this.piece.panels
      .filter((panel) => this.step === null || panel.step <= this.step)
      .map((panel) => ({
        text: panel.name, name: this.step === panel.step ? "number lit" : "number", colour: null, always: true,
        place: () => this.view.hub(panel.hub),
      }));
  }

  /** The names of the joints that this step closes; first the ends of every seam, which stay where there is little room. @private */
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

  /** What is to be done in this step. @private */
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

  /** From flat to assembled, or from where it was stopped. */
  play() {
    if (this.playing) return this.stop();
    const from = this.time >= this.piece.length ? 0 : this.time;
    this.run(from, this.piece.length);
    this.find("[name=play]").setAttribute("aria-pressed", "true");
  }

  /** The panel of this step flies to its place, seen from outside. */
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

  /** @private @param {number} from @param {number} to @param {THREE.Vector3} [way]  from where to look at it */
  run(from, to, way) {
    this.stop();
    const began = performance.now();
    let last = began;
    const tick = (now) => {
      const time = Math.min(from + Math.max(now - began, 0) / 1000 / SECONDS, to);
      // what is left of the turn becomes less evenly, so that a hand on the piece is not fought for long
      if (way && now - began < 1000 * FACING) this.view.turnTo(way, 1 - Math.exp((-5 * (now - last)) / (1000 * FACING)));
      last = now;
      this.show(time);
      if (time < to) this.playing = requestAnimationFrame(tick);
      else this.stop();
    };
    this.playing = requestAnimationFrame(tick);
  }

  /** @private */
  async save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await this.view.picture());
    link.download = `${this.piece.title || "piece"}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
}

/** @param {THREE.Color[]} colours @param {number} value  from 0 to 1 @param {THREE.Color} out */
function onScale(colours, value, out) {
  const place = value * (colours.length - 1);
  const low = Math.min(Math.floor(place), colours.length - 2);
  // as the legend's gradient is mixed
  const [one, two] = [colours[low].clone().convertLinearToSRGB(), colours[low + 1].clone().convertLinearToSRGB()];
  return out.copy(one.lerp(two, place - low)).convertSRGBToLinear();
}

/** @param {number} value */
function rounded(value) {
  return value === 0 ? "0" : Number(value.toPrecision(3)).toString();
}

/** Start the view in its element; without WebGL the pictures that stand in its place are shown. On paper they always are. */
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
 * For tests and the curious: `flexmaps.at(time)` puts the piece there; `hubs` are the hubs' centres, `corners` those of their
 * arms, in millimetres.
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
      /** Milliseconds of a picture of everything, also when nothing has changed. */
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
