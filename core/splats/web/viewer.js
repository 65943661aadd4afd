"use strict";
// The page: reads the scene that is embedded in it, and ties the controls to the renderer.

const find = (id) => document.getElementById(id);
const OBSERVERS = { normal: "normal vision", protan: "protan", deutan: "deutan", tritan: "tritan", achromat: "achromat" };
const ORIGINAL = "Original";  // what a first layer in the photographs' own colours is called
const MANY = 300000;       // Gaussians from which on the detail can be chosen
const MOST_ON_PHONES = 400000, MOST_ELSEWHERE = 1500000;  // that are drawn at first
const MOST_PATIENCE = 1000;  // milliseconds that the first picture of many may take; otherwise fewer are drawn
const SLOW_FRAME = 60;     // milliseconds from one frame to the next, above which moving pictures get coarser
const TAKEN_AWAY = "The graphics card was taken away; load the page again.";
const STEADY_AFTER = 180;  // milliseconds without a move, after which the picture is drawn in full

// Columns and bytes of one kind lie together; `stride` bytes of the result are a row.
function rows(planes, count, columns, bytes, stride) {
  const result = new Uint8Array(count * stride);
  for (let column = 0, from = 0; column < columns; column++)
    for (let byte = 0; byte < bytes; byte++)
      for (let row = 0, to = column * bytes + byte; row < count; row++, to += stride) result[to] = planes[from++];
  return result.buffer;
}

async function stream(name) {
  const element = find(`data-${name}`), text = atob(element.textContent);
  element.remove();  // a large scene should be in memory once
  const packed = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) packed[i] = text.charCodeAt(i);
  const plain = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(plain).arrayBuffer());
}

async function readScene() {
  const scene = JSON.parse(find("scene").textContent), count = scene.count;
  scene.means = new Float32Array(rows(await stream("means"), count, 3, 4, 12));
  scene.shapes = new Uint32Array(rows(await stream("shapes"), count, 8, 2, 16));
  for (const [number, layer] of scene.layers.entries()) {
    layer.colors = new Uint16Array(rows(await stream(`colors${number}`), count, 3, 2, 6));
    const terms = 3 * ((layer.degree + 1) ** 2 - 1);
    layer.rest = new Uint32Array(terms ? rows(await stream(`rest${number}`), count, terms, 1, 16 * Math.ceil(terms / 16)) : 16);
  }
  return scene;
}

// Sorts beside the page, or within it where the browser allows no worker: some say so with an exception, others later.
function sorterOf(scene) {
  const text = find("sorter").textContent, waiting = new Map();
  let worker = null, sort = null, ticket = 0;
  const sortHere = ({ row, count, done, failed }) => {
    try {
      if (!sort) {
        const script = document.createElement("script");
        script.textContent = text;
        document.head.append(script);
        sort = makeSorter(scene.means);
      }
      done(sort(row, scene.near, count));
    } catch (error) { failed(error); }
  };
  try {
    worker = new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
    worker.postMessage({ means: scene.means });
    worker.onmessage = ({ data }) => {
      waiting.get(data.ticket)?.done(data.order);
      waiting.delete(data.ticket);
    };
    worker.onerror = () => {
      worker = null;
      waiting.forEach(sortHere);
      waiting.clear();
    };
  } catch { worker = null; }
  return (row, count) => new Promise((done, failed) => {
    const asked = { row, count, done, failed };
    if (!worker) return sortHere(asked);
    waiting.set(++ticket, asked);
    worker.postMessage({ row, near: scene.near, count, ticket });
  });
}

class Viewer {
  constructor(scene) {
    this.scene = scene;
    this.canvas = find("view");
    this.renderer = new Renderer(this.canvas, scene);
    this.sort = sorterOf(scene);
    this.orbit = new Orbit(scene.up, scene.radius);
    this.layer = Math.min(1, scene.layers.length - 1);
    this.observer = "normal";
    this.place = scene.start;
    this.scale = 1;
    const phone = matchMedia("(pointer: coarse)").matches;
    this.count = Math.min(scene.count, phone ? MOST_ON_PHONES : MOST_ELSEWHERE);
    this.fixed = null;  // a camera to draw from instead of the orbit, for measurements
    this.home();
  }

  get hasLayers() { return this.scene.layers.length > 1; }
  get startsOriginal() { return this.scene.first === ORIGINAL; }
  get title() { return `Enhanced for ${this.scene.names[this.layer]}`; }
  get wipes() { return this.hasLayers && find("wipes").checked; }

  home() {
    this.goTo(this.scene.start);
  }

  // Stand where the photograph of this number was taken, upright.
  goTo(number) {
    const cameras = this.scene.cameras;
    if (!cameras.length) {
      Object.assign(this.orbit, new Orbit(this.scene.up, this.scene.radius));
      return this.moved();
    }
    this.place = (number + cameras.length) % cameras.length;
    const { rotation: r, translation: t } = cameras[this.place];
    const eye = [0, 1, 2].map((i) => -(r[i] * t[0] + r[3 + i] * t[1] + r[6 + i] * t[2]));
    const forward = r.slice(6);
    this.orbit.stand(eye, forward, this.depthAhead(eye, r, t, cameras[this.place]));
    this.moved();
  }

  // Median depth of what is in the middle of the picture: the point around which the scene is turned.
  depthAhead(eye, r, t, camera) {
    const means = this.scene.means, depths = [];
    const wide = (0.25 * camera.width) / camera.fx, high = (0.25 * camera.height) / camera.fy;
    for (let k = 0; k < Math.min(means.length, 300000); k += 3) {
      const [x, y, z] = [0, 3, 6].map((i) => r[i] * means[k] + r[i + 1] * means[k + 1] + r[i + 2] * means[k + 2] + t[i / 3]);
      if (z > this.scene.near && Math.abs(x) < wide * z && Math.abs(y) < high * z) depths.push(z);
    }
    return depths.length ? depths.sort((a, b) => a - b)[depths.length >> 1] : this.scene.radius;
  }

  camera() {
    if (this.fixed) return this.fixed;
    const dense = Math.min(devicePixelRatio || 1, 2) * this.scale;
    const width = Math.max(Math.round(this.canvas.clientWidth * dense), 16);
    const height = Math.max(Math.round(this.canvas.clientHeight * dense), 16);
    const lens = this.scene.cameras[this.place];
    const half = Math.tan(this.scene.fieldOfView / 2);
    // All of the photograph's field of view is in the picture.
    const focal = lens ? Math.min((width * lens.fx) / lens.width, (height * lens.fy) / lens.height)
      : Math.min(width, height) / 2 / half;
    return { ...this.orbit.pose(), width, height, fx: focal, fy: focal, cx: width / 2, cy: height / 2 };
  }

  look() {
    const amount = this.hasLayers ? Number(find("amount").value) / 100 : 0;
    const wipe = this.wipes ? Number(find("wipe").value) / 100 : null;
    return { layer: this.layer, amounts: [0, amount], wipe, simulation: this.simulation() };
  }

  simulation() {
    const table = this.scene.simulation[this.observer];
    if (!table) return null;
    const place = Number(find("severity").value) * (table.above.length - 1);
    const low = Math.min(Math.floor(place), table.above.length - 2), share = place - low;
    const between = (steps) => steps[low].map((x, i) => (1 - share) * x + share * steps[low + 1][i]);
    return { above: between(table.above), below: between(table.below), separator: table.separator };
  }

  moved() {
    this.lastMove = performance.now();
    this.request();
  }

  request() {
    if (this.requested) return;
    this.requested = true;
    requestAnimationFrame((now) => {
      this.requested = false;
      this.frame(now);
    });
  }

  frame(now) {
    if (this.holds) return;
    const moving = now - this.lastMove < STEADY_AFTER;
    if (moving && this.lastFrame && now - this.lastFrame < 1000) {
      if (now - this.lastFrame > SLOW_FRAME) this.scale = Math.max(0.8 * this.scale, 0.35);
    }
    if (!moving) this.scale = 1;
    this.lastFrame = moving ? now : 0;
    this.draw();
    if (moving) this.request();
  }

  draw() {
    const camera = this.camera();
    this.renderer.draw(camera, this.look());
    this.sortFor(camera);
  }

  // One sorting at a time; the picture follows when it is there.
  async sortFor(camera) {
    const row = [...camera.rotation.slice(6), camera.translation[2]];
    const key = `${row} ${this.count}`;
    if (this.sorting || key === this.sorted) return;
    this.sorting = true;
    const order = await this.sort(row, this.count);
    this.sorting = false;
    if (this.holds) return;
    this.renderer.setOrder(order);
    this.sorted = key;
    this.request();
  }

  // The picture from `camera` (or from where the page is), sorted and complete.
  async drawNow(camera = null) {
    this.holds = true;  // whatever else would be drawn meanwhile
    this.fixed = camera;
    this.scale = 1;
    const from = this.camera();
    const row = [...from.rotation.slice(6), from.translation[2]];
    this.renderer.setOrder(await this.sort(row, this.count));
    this.sorted = "";
    this.renderer.draw(from, this.look());
    this.fixed = null;
    this.holds = false;
  }

  // Draw fewer Gaussians where this machine takes too long.
  async spare() {
    const started = performance.now();
    this.renderer.finish();
    const took = performance.now() - started;
    if (took <= MOST_PATIENCE) return;
    this.count = Math.max(Math.round((this.count * MOST_PATIENCE) / took), Math.min(MANY, this.count));
    await this.drawNow();
  }

  async picture(camera = null) {
    await this.drawNow(camera);
    const blob = new Promise((done) => this.canvas.toBlob(done, "image/png"));  // of what is drawn now
    this.request();
    return blob;
  }

  async saveStill() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await this.picture());
    link.download = `${this.describe().toLowerCase().replace(/[^a-z0-9.]+/g, "-").replace(/^-|-$/g, "")}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    say(`Saved ${link.download}`);
  }

  describe() {
    const amount = Number(find("amount").value);
    const first = this.scene.first;
    if (!this.hasLayers || amount === 0) return (this.startsOriginal ? `${first} colours` : first) + this.seen();
    const colours = this.wipes ? `${first} beside ${this.title.replace("E", "e")}` : this.title;
    return `${colours}${amount < 100 ? `, ${amount} %` : ""}${this.seen()}`;
  }

  seen() {
    if (this.observer === "normal") return "";
    const severity = find("severity").value;
    return `, as ${OBSERVERS[this.observer]} vision${severity === "1" ? "" : ` of severity ${severity}`} sees it`;
  }
}

const say = (text) => { find("said").textContent = text; };

function choices(box, name, entries, chosen, choose) {
  for (const [value, text] of entries) {
    const label = document.createElement("label"), input = document.createElement("input"), span = document.createElement("span");
    Object.assign(input, { type: "radio", name, value, checked: value === chosen });
    input.addEventListener("change", () => choose(value));
    span.textContent = text;
    label.append(input, span);
    box.append(label);
  }
}

function connect(viewer) {
  const { scene, canvas } = viewer;
  const show = () => {
    const amount = find("amount");
    find("amount-text").value = `${amount.value} %`;
    const ends = viewer.startsOriginal ? [ORIGINAL, "Enhanced"] : [scene.first, viewer.title];
    const [from, to] = ends.map((text) => text.toLowerCase());
    ["amount-from", "amount-to"].forEach((id, end) => { find(id).textContent = ends[end]; });
    amount.setAttribute("aria-label", `From ${from} to ${to}${viewer.startsOriginal ? " colours" : ""}`);
    amount.setAttribute("aria-valuetext", amount.value === "0" ? from : `${amount.value} percent ${to}`);
    find("wipe").setAttribute("aria-label", `Where ${from} and ${to} meet`);
    find("severity-text").value = `severity ${Number(find("severity").value).toFixed(2)}`;
    find("severity-row").hidden = viewer.observer === "normal";
    find("budget-text").value = `${viewer.count.toLocaleString("en")} Gaussians`;
    find("wipe-row").hidden = find("divider").hidden = find("tag-left").hidden = !viewer.wipes;
    find("divider").style.left = `${find("wipe").value}%`;
    find("tag-left").textContent = `${scene.first}${viewer.seen()}`;
    find("tag-right").textContent = viewer.wipes
      ? `${viewer.title}${viewer.seen()}` : viewer.describe();
    find("caption").textContent = scene.captions[viewer.layer];
    viewer.request();
  };
  const tell = () => say(viewer.describe());
  const input = (id, after = () => {}) => {
    find(id).addEventListener("input", () => { after(); show(); });
    find(id).addEventListener("change", tell);
  };

  find("colours").hidden = !viewer.hasLayers;
  const layers = scene.names.slice(1).map((name, number) => [number + 1, `for ${name}`]);
  if (layers.length > 1) choices(find("layers"), "layer", layers, 1, (value) => { viewer.layer = value; show(); tell(); });
  choices(find("observers"), "observer", Object.entries(OBSERVERS), "normal", (value) => {
    viewer.observer = value;
    show();
    tell();
  });
  input("amount");
  input("wipe");
  input("wipes");
  input("severity");
  find("budget-row").hidden = scene.count < MANY;
  find("budget").value = Math.round((100 * viewer.count) / scene.count);
  input("budget", () => { viewer.count = Math.max(Math.round((scene.count * find("budget").value) / 100), 1); });

  const actions = {
    home: () => viewer.home(),
    previous: () => viewer.goTo(viewer.place - 1),
    next: () => viewer.goTo(viewer.place + 1),
    still: () => viewer.saveStill(),
    full: () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()),
  };
  for (const [id, act] of Object.entries(actions)) find(id).addEventListener("click", act);
  find("previous").hidden = find("next").hidden = !scene.cameras.length;
  find("full").hidden = !document.fullscreenEnabled;
  find("controls").addEventListener("submit", (event) => event.preventDefault());

  const keys = { Home: "home", n: "next", p: "previous", s: "still" };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (pressKey(viewer.orbit, event)) viewer.moved();
    else if (keys[event.key]) actions[keys[event.key]]();
    else if (event.key === " " && viewer.hasLayers) {
      find("amount").value = find("amount").value === "0" ? 100 : 0;
      show();
      tell();
    } else return;
    event.preventDefault();
  });
  listenToHands(canvas, viewer.orbit, () => viewer.moved());

  const divider = find("divider");
  divider.addEventListener("pointerdown", (event) => divider.setPointerCapture(event.pointerId));
  divider.addEventListener("pointermove", (event) => {
    if (!divider.hasPointerCapture(event.pointerId)) return;
    const box = canvas.getBoundingClientRect();
    find("wipe").value = (100 * (event.clientX - box.left)) / box.width;
    show();
  });
  new ResizeObserver(() => viewer.request()).observe(canvas);
  canvas.addEventListener("webglcontextlost", () => fail(new Error(TAKEN_AWAY)));
  show();
}

// Say why, and show the pictures instead.
function fail(error) {
  document.body.classList.add("fails");
  find("cover").hidden = false;
  const pictures = find("instead").childElementCount;
  find("cover").textContent = `${error.message} ${pictures ? "These pictures show the scene instead." : "Another browser may show the scene."}`;
  find("controls").hidden = find("view").hidden = find("tag-right").hidden = true;
  find("instead").hidden = !pictures;
}

async function start() {
  try {
    if (!window.DecompressionStream) throw new Error("This browser is too old to open the scene.");
    // Before the scene is read, because that would be in vain.
    if (!document.createElement("canvas").getContext("webgl2")) throw new Error("This browser has no WebGL 2.");
    const scene = await readScene();
    const viewer = new Viewer(scene);
    find("controls").hidden = false;
    await viewer.drawNow();
    if (scene.count >= MANY) await viewer.spare();
    // A large scene may lose the graphics while it loads, before anybody listens: the picture would just stay black.
    if (viewer.renderer.isLost) throw new Error(TAKEN_AWAY);
    connect(viewer);
    find("cover").hidden = true;
    window.cvdgs = viewer;
    document.documentElement.dataset.ready = Math.round(performance.now());
  } catch (error) {
    console.error(error);
    fail(error);
  }
}
start();
