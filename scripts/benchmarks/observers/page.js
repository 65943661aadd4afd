// The course of a session: consent, caps, pairs, the file. What was answered is kept in this browser alone.
"use strict";
const study = JSON.parse(document.getElementById("study").textContent);
const main = document.getElementById("main");
const STORE = `cvdgs-observers-${study.study}`;
const CAPS = study.caps.length - 1; // the first one is the reference
const SETTLE = 300; // milliseconds without a pair between two, in which keys do nothing
const FRAME = 1000 / 12; // milliseconds, of a turntable

// Mulberry32 (Tommy Ettinger, public domain): numbers in [0, 1) from a 32-bit seed.
function generator(seed) {
  return () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

function shuffled(items, random) {
  const result = [...items];
  for (let i = result.length - 1; i > 0; i--) {
    const j = Math.floor(random() * (i + 1));
    [result[i], result[j]] = [result[j], result[i]];
  }
  return result;
}

// The type whose pictures somebody sees; core/color/arrangement.py says where the figures come from.
function typeOf(order) {
  const moments = (caps) => {
    let [uu, uv, vv] = [0, 0, 0];
    const row = [0, ...caps].map((cap) => study.arrangement.uv[cap]);
    for (let i = 1; i < row.length; i++) {
      const [du, dv] = [row[i][0] - row[i - 1][0], row[i][1] - row[i - 1][1]];
      uu += du * du; uv += du * dv; vv += dv * dv;
    }
    const [middle, spread] = [(uu + vv) / 2, Math.hypot((uu - vv) / 2, uv)];
    const angle = (Math.atan2(2 * uv, uu - vv) / 2) * (180 / Math.PI);
    return { major: Math.sqrt(middle + spread), minor: Math.sqrt(Math.max(middle - spread, 0)), angle };
  };
  const found = moments(order);
  const perfect = moments(Array.from({ length: CAPS }, (_, i) => i + 1));
  if (found.major / perfect.major <= study.arrangement.confusion) return "";
  if (found.major / found.minor < study.arrangement.selectivity) return "";
  const within = (axis) => [found.angle, found.angle - 180].some((angle) => axis.low <= angle && angle < axis.high);
  return (study.arrangement.axes.find(within) || { cvd: "" }).cvd;
}

// All pairs of the stimuli for a type, under each question; some a second time, later and with sides exchanged.
function trialsOf(seed, cvd) {
  const random = generator(seed);
  const trials = [];
  for (const question of shuffled(study.questions, random)) {
    let block = [];
    for (const stimulus of study.stimuli.filter((item) => item.cvd === cvd)) {
      stimulus.versions.forEach((first, i) => stimulus.versions.slice(i + 1).forEach((second) => {
        const sides = shuffled([first, second], random);
        block.push({ question, left: sides[0], right: sides[1], repeat: false });
      }));
    }
    block = shuffled(block, random);
    const early = block.slice(0, Math.ceil(block.length / 2));
    const again = shuffled(early, random).slice(0, Math.round(block.length * study.repeated))
      .map((trial) => ({ ...trial, left: trial.right, right: trial.left, repeat: true }));
    trials.push(...early, ...shuffled([...block.slice(early.length), ...again], random));
  }
  return trials;
}

// The seed is also the participant's number: the address gives it to one of them, and another one gets another.
function newSession(before = 0) {
  const given = Number(new URLSearchParams(location.hash.slice(1)).get("seed")) >>> 0; // 32 bits, as the file may hold
  const seed = given && given !== before ? given : crypto.getRandomValues(new Uint32Array(1))[0];
  const pool = shuffled(Array.from({ length: CAPS }, (_, i) => i + 1), generator(seed ^ 0x5bd1e995));
  return { study: study.study, seed, stage: "welcome", pool, row: Array(CAPS).fill(0), cvd: "", answers: [] };
}

function stored() {
  try {
    const session = JSON.parse(localStorage.getItem(STORE));
    return session && session.study === study.study ? session : null;
  } catch { return null; }
}

function keep() {
  try { localStorage.setItem(STORE, JSON.stringify(session)); } catch { /* no storage: the page still works */ }
}

const earlier = stored();
let session = earlier || newSession();
let trials = session.cvd ? trialsOf(session.seed, session.cvd) : []; // there is a type once the row is finished
let timer = 0; // of a turntable
let onKey = () => {};
document.addEventListener("keydown", (event) => { if (!event.repeat) onKey(event); });

function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

function button(label, className, action) {
  return element("button", { type: "button", className, textContent: label, onclick: action });
}

function show(...children) {
  clearInterval(timer);
  onKey = () => {};
  main.replaceChildren(...children);
  main.dataset.stage = session.stage;
  keep();
}

function goTo(stage) {
  session.stage = stage;
  ({ welcome, caps, begin, pairs, done })[stage]();
}

function beginAnew() {
  session = newSession(session.seed);
  goTo("welcome");
}

// Somebody began in this browser: the same person, or on a shared computer the one before.
function welcomeBack() {
  const goOn = button("Go on where I stopped", "main", () => goTo(session.stage));
  const anew = button("I am somebody else. Begin anew", "plain", () => {
    if (session.answers.length && !session.saved) save();
    beginAnew();
  });
  show(element("div", { className: "text" },
    element("h1", { textContent: "Somebody has begun on this computer" }),
    element("p", { textContent: "If it was you, go on. If it was somebody else, begin anew: answers that were not saved yet "
      + "are saved as a file first, for the person who asked you." }),
    goOn, anew));
  main.dataset.stage = "back";
  goOn.focus();
}

function welcome() {
  const text = element("div", { className: "text" },
    element("h1", { textContent: "Telling colours apart" }),
    element("p", { textContent: "First you put fifteen coloured caps in a row. Then you compare pictures, two at a time. "
      + `It takes about ${study.minutes} minutes, and you can close the page and go on later.` }),
    element("p", { textContent: "Taking part is voluntary, and you can stop at any time by closing this page." }),
    element("p", { textContent: "Your answers stay in this browser until you save them as a file, which holds the row "
      + "of caps, your choices and how long each took, and nothing about who you are." }),
    element("p", { className: "small", textContent: "Please turn off night mode and dark filters, make the screen "
      + "bright, and look at it straight on. Wear the glasses that you usually wear, but no colour filters. This is not "
      + "a diagnosis." }),
    button("I agree. Begin", "main", () => goTo("caps")));
  show(text);
  text.lastChild.focus();
}

function caps() {
  const row = element("div", { className: "tray" });
  const pool = element("div", { className: "tray pool" });
  const next = button("The row is finished", "main", () => {
    const found = typeOf(session.row);
    session.cvd = study.types.includes(found) ? found : study.types[0];
    trials = trialsOf(session.seed, session.cvd);
    goTo("begin");
  });
  const cap = (number, place, action) => {
    const letter = String.fromCharCode(65 + session.pool.indexOf(number));
    const made = button("", "cap", action);
    made.style.background = study.caps[number];
    made.dataset.cap = number;
    made.setAttribute("aria-label", `Cap ${letter}, ${place}`);
    return made;
  };
  function draw(focusOn) {
    const fixed = element("div", { className: "cap fixed" });
    fixed.style.background = study.caps[0];
    row.replaceChildren(fixed, ...session.row.map((number, i) => number
      ? cap(number, `place ${i + 1} of the row`, () => { session.row[i] = 0; draw(number); })
      : element("div", { className: "slot" })));
    pool.replaceChildren(...session.pool.map((number) => session.row.includes(number)
      ? element("div", { className: "slot" })
      : cap(number, "not in the row", () => {
        session.row[session.row.indexOf(0)] = number;
        draw(session.pool.find((other) => !session.row.includes(other)));
      })));
    next.disabled = session.row.includes(0);
    keep();
    const target = focusOn && main.querySelector(`[data-cap="${focusOn}"]`);
    if (target) target.focus({ preventScroll: true });
    else if (!next.disabled) next.focus();
  }
  show(element("h1", { textContent: "Put the caps in a row" }),
    element("p", { textContent: "The square cap is the first and stays. Of the caps below, choose the one whose colour is most "
      + "like it, then the one most like that, and so on. A cap in the row goes back when you choose it, and the next "
      + "one fills its place." }),
    row, pool,
    element("footer", {}, next, element("span", { className: "small" }, "Keyboard: ", element("kbd", {}, "←"), " ",
      element("kbd", {}, "→"), " to move, ", element("kbd", {}, "Enter"), " to choose")));
  onKey = (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const all = [...main.querySelectorAll("button:not(:disabled)")];
    if (step) all[(all.indexOf(document.activeElement) + step + all.length) % all.length].focus();
  };
  draw(session.pool.find((number) => !session.row.includes(number)));
}

function questionAt(place) { return trials[Math.min(place, trials.length - 1)].question; }

// Before each block: the question, at leisure.
function begin() {
  const place = session.answers.length;
  const block = trials.filter((trial) => trial.question === questionAt(place));
  const start = button("Start", "main", () => goTo("pairs"));
  const text = element("div", { className: "text" },
    element("p", { textContent: place ? "Half of it is done. Now the question changes." : "The row is finished. Thank you." }),
    element("h1", { textContent: questionAt(place).text }),
    element("p", { textContent: `You will see ${block.length} pairs of pictures. Choose one of each pair by clicking or `
      + "tapping it, or with the arrow keys. If they look the same to you, choose by your first feeling." }),
    start);
  show(text);
  start.focus();
}

function pairs() {
  const place = session.answers.length;
  if (place >= trials.length) return goTo("done");
  const trial = trials[place];
  const sides = [["Left", trial.left], ["Right", trial.right]];
  const stage = element("div", { className: "pair away" });
  let since = Infinity;
  const choose = (code) => {
    if (performance.now() < since) return;
    const ms = Math.min(Math.round(performance.now() - since), 3600000);
    const { question, left, right, repeat } = trial;
    session.answers.push({ question: question.id, left: left.code, right: right.code, choice: code, repeat, ms });
    const following = trials[place + 1];
    goTo(following && following.question !== question ? "begin" : "pairs");
  };
  const images = sides.map(([, version]) => element("img", { src: version.frames[0], alt: "", draggable: false }));
  stage.append(...sides.map(([label, version], i) => {
    const made = element("button", { type: "button", className: "choice", onclick: () => choose(version.code) }, images[i],
      element("span", {}, label));
    made.setAttribute("aria-label", `The ${label.toLowerCase()} picture`);
    return made;
  }));
  const back = button("Undo the last answer", "plain", () => { session.answers.pop(); goTo("pairs"); });
  back.disabled = place === 0;
  const bar = element("progress", { max: trials.length, value: place });
  bar.setAttribute("aria-label", "Progress");
  show(element("h1", { textContent: trial.question.text }), stage,
    element("footer", {}, back, bar, element("span", { className: "small" }, `${place + 1} of ${trials.length}`)));
  onKey = (event) => {
    if (event.key === "ArrowLeft") choose(trial.left.code);
    if (event.key === "ArrowRight") choose(trial.right.code);
    if (event.key === "Backspace" && place) { event.preventDefault(); back.click(); }
  };
  Promise.all(images.map((image) => image.decode().catch(() => {}))).then(() => setTimeout(() => {
    if (!stage.isConnected) return; // the answer before was undone in the meantime
    stage.classList.remove("away");
    since = performance.now();
    main.dataset.ready = place;
    const frames = trial.left.frames.length;
    let frame = 0;
    if (frames > 1) timer = setInterval(() => {
      frame = (frame + 1) % frames;
      images.forEach((image, i) => { image.src = sides[i][1].frames[frame]; });
    }, FRAME);
  }, SETTLE));
}

function exported() {
  const { seed, row, cvd, answers } = session;
  return { format: study.format, version: 1, study: study.study, participant: seed.toString(16), arrangement: row, cvd,
    answers };
}

function save() {
  const link = element("a", { download: `answers-${study.study}-${session.seed.toString(16)}.json`,
    href: URL.createObjectURL(new Blob([JSON.stringify(exported(), null, 1)], { type: "application/json" })) });
  link.click();
  session.saved = true;
  keep();
}

function done() {
  const again = button("Remove my answers from this browser, and start anew", "plain", beginAnew);
  again.hidden = !session.saved;
  const file = button("Save my answers", "main", () => { save(); again.hidden = false; });
  show(element("div", { className: "text" }, element("h1", { textContent: "That was all. Thank you." }),
    element("p", { textContent: "Save your answers as a file, and give the file to the person who asked you." }), file,
    again));
  file.focus();
}

if (earlier && earlier.stage !== "welcome") welcomeBack();
else goTo(session.stage);
