// Takes part in a study without a browser: runs the page's script on as much of a document as it asks for, and answers
// with the keyboard. Closing the page keeps what it stored.
//
//     node participant.js PAGE.html ROW.json STEPS.json      writes what the page shows after each step as JSON, with the
//                                                            files saved so far and the turntables that turn unseen
//
// Steps: "arrange" puts the caps in the row; "tick" lets a second pass; "reload"; "#seed=5" opens the page with that;
// the label of a button; or a key.

const fs = require("fs");
const vm = require("vm");

const [pageFile, rowFile, stepsFile] = process.argv.slice(2);
const text = fs.readFileSync(pageFile, "utf-8");
const study = text.match(/<script type="application\/json" id="study">([^]*?)<\/script>/)[1];
const script = text.match(/<script>([^]*?)<\/script>/)[1];
const row = JSON.parse(fs.readFileSync(rowFile, "utf-8"));
const storage = new Map(), files = [];
let hash = "#seed=77";

class Element {
    constructor(tag) {
        Object.assign(this, { tag, children: [], dataset: {}, style: {}, textContent: "", classList: new Set() });
        this.classList.remove = this.classList.delete;
    }
    append(...nodes) { this.children.push(...nodes); }
    replaceChildren(...nodes) { this.children = nodes; }
    get lastChild() { return this.children.at(-1); }
    get all() { return this.children.filter((node) => node.tag).flatMap((node) => [node, ...node.all]); }
    setAttribute() {}
    focus() {}
    decode() { return Promise.resolve(); }
    get isConnected() { return page.main.all.includes(this); }
    click() {
        if (this.download) files.push(JSON.parse(this.href));
        else if (!this.disabled) this.onclick();
    }
    querySelector(selector) {
        const [, cap] = selector.match(/^\[data-cap="(\d+)"\]$/);
        return this.all.find((element) => element.dataset.cap === Number(cap)) || null;
    }
    querySelectorAll() { return this.all.filter((element) => element.tag === "button"); }
}

let page;
function open() {
    const main = new Element("main"), timeouts = [];
    const turning = new Set();
    let key, now = 0, timers = 0;
    const window = {
        document: {
            getElementById: (id) => (id === "study" ? { textContent: study } : main),
            createElement: (tag) => new Element(tag),
            addEventListener: (_, listener) => { key = listener; },
        },
        localStorage: {
            getItem: (name) => storage.get(name) ?? null,
            setItem: (name, value) => storage.set(name, value),
        },
        location: { hash },
        crypto: { getRandomValues: (numbers) => numbers.fill(0xfeedbeef) },
        Blob: class { constructor([text]) { this.text = text; } },
        URL: { createObjectURL: (blob) => blob.text },
        performance: { now: () => now },
        setTimeout: (done) => { timeouts.push(done); },
        setInterval: () => { turning.add(++timers); return timers; },  // turntables stand still
        clearInterval: (timer) => { turning.delete(timer); },
        URLSearchParams,
    };
    const press = (name) => key({ key: name, repeat: false, preventDefault: () => {} });
    const tick = async () => {
        await new Promise((done) => setImmediate(done));
        now += 1000;
        timeouts.splice(0).forEach((done) => done());
    };
    page = { main, press, tick, turning };
    vm.runInNewContext(script, window);
}

async function step(what) {
    const button = () => page.main.all.find((element) => element.tag === "button" && element.textContent === what);
    if (what.startsWith("#")) hash = what;
    if (what === "reload" || what === hash) open();
    else if (what === "arrange") for (const cap of row) page.main.querySelector(`[data-cap="${cap}"]`).click();
    else if (what === "tick") await page.tick();
    else if (button()) button().click();
    else page.press(what);
}

(async () => {
    open();
    const shown = [];
    for (const what of JSON.parse(fs.readFileSync(stepsFile, "utf-8"))) {
        await step(what);
        const headline = page.main.all.find((element) => element.tag === "h1");
        shown.push({ stage: page.main.dataset.stage, headline: headline?.textContent ?? "", files: [...files],
            turning: page.turning.size });
    }
    console.log(JSON.stringify(shown));
})();
