// Opens a scene's page without a browser: runs its scripts on as much of a document, and of WebGL, as they ask for.
// Nothing is drawn; what is told is how far the page comes where a part of the browser fails.
//
//     node visitor.js PAGE.html FAULT      writes what the visitor has before him as JSON
//
// Faults: "none"; "worker refused", with an exception as older browsers do; "worker blocked", with an event as the
// standard says; "worker breaks" at its first work; "context lost" or "memory full" while the scene is uploaded.

const fs = require("fs");
const vm = require("vm");

const [pageFile, fault] = process.argv.slice(2);
const LONG_ENOUGH = 5000;  // milliseconds, for a page to open
const text = fs.readFileSync(pageFile, "utf-8");
const elements = new Map();
let context, lost = false, full = false, drawn = 0;

class Element {
    constructor(textContent = "") {
        Object.assign(this, { textContent, value: "50", style: {}, dataset: {}, childElementCount: 0 });
        Object.assign(this, { classList: new Set(), clientWidth: 160, clientHeight: 120 });
    }
    addEventListener() {}
    setAttribute() {}
    remove() {}
    append() {}
    getContext() { return gl; }
}

for (const [, id, content] of text.matchAll(/ id="([\w-]+)"[^>]*>([^<]*)/g)) elements.set(id, new Element(content));
const sorter = elements.get("sorter").textContent = text.match(/id="sorter">([^]*?)<\/script>/)[1];

const gl = new Proxy({
    MAX_TEXTURE_SIZE: 1, ACTIVE_UNIFORMS: 2, OUT_OF_MEMORY: 3, LINK_STATUS: 4, NO_ERROR: 0,
    getParameter: () => 4096,
    getProgramParameter: (_, name) => name === 4 && !lost,
    isContextLost: () => lost,
    getError: () => (full ? 3 : 0),
    texImage2D: () => {
        lost ||= fault === "context lost";
        full ||= fault === "memory full";
    },
    drawArraysInstanced: (mode, first, corners, count) => { drawn = count; },
}, { get: (known, name) => known[name] ?? (() => ({})) });

class Worker {
    constructor() {
        if (fault === "worker refused") throw new Error("refused");
        if (fault === "worker blocked") setImmediate(() => this.onerror?.({}));
        class WorkerGlobalScope {}
        const self = new WorkerGlobalScope();
        self.postMessage = (data) => setImmediate(() => this.onmessage({ data }));
        this.self = self;
        vm.runInNewContext(sorter, { WorkerGlobalScope, self });
    }
    postMessage(data) {
        if (fault === "worker blocked") return;
        if (fault === "worker breaks" && data.row) setImmediate(() => this.onerror?.({}));
        else this.self.onmessage({ data });
    }
    terminate() {}
}

const window = {
    document: {
        body: new Element(), documentElement: new Element(),
        head: { append: (script) => vm.runInContext(script.textContent, context) },
        getElementById: (id) => elements.get(id),
        createElement: () => new Element(),
    },
    matchMedia: () => ({ matches: false }),
    requestAnimationFrame: (done) => setTimeout(() => done(performance.now()), 5),
    URL: { createObjectURL: () => "blob:" },
    ResizeObserver: class { observe() {} },
    console: { error: () => {} },
    Worker, Blob, Response, DecompressionStream, atob, performance, setTimeout, devicePixelRatio: 1,
};
context = vm.createContext(window);
window.window = window;
for (const [, script] of text.matchAll(/<script>([^]*?)<\/script>/g)) vm.runInContext(script, context);

const started = performance.now();
const waiting = setInterval(() => {
    const opens = elements.get("cover").hidden === true, fails = window.document.body.classList.has("fails");
    if (!opens && !fails && performance.now() - started < LONG_ENOUGH) return;
    clearInterval(waiting);
    console.log(JSON.stringify({ opens, fails, said: elements.get("cover").textContent, drawn }));
    process.exit(0);
}, 20);
