// Plays the turntables of the page that are in view, turns them by hand, and switches between layers.
"use strict";

const calm = matchMedia("(prefers-reduced-motion: reduce)");

class Player {
  constructor(turn) {
    this.turn = turn;
    this.video = turn.querySelector("video");
    this.stage = turn.querySelector(".stage");
    this.button = turn.querySelector(".play");
    this.slider = turn.querySelector("input[type=range]");
    this.output = turn.querySelector("output");
    this.wanted = !calm.matches;
    this.inView = false;
    turn.querySelector(".transport").hidden = false;
    this.button.addEventListener("click", () => this.want(!this.wanted));
    this.slider.addEventListener("input", () => this.turnTo(Number(this.slider.value)));
    this.video.addEventListener("play", () => this.follow());
    this.video.addEventListener("error", () => this.video.remove()); // the still below stays
    this.stage.addEventListener("pointerdown", (event) => this.drag(event));
    this.say();
  }

  want(playing) {
    this.wanted = playing;
    this.update();
    this.say();
  }

  update() {
    if (this.wanted && this.inView && !this.turn.hidden) this.video.play().catch(() => {});
    else this.video.pause();
  }

  say() {
    this.button.textContent = this.wanted ? "Pause" : "Play";
  }

  turnTo(angle) {
    this.want(false);
    const duration = this.video.duration || 0;
    // Half a picture further, because a time between two pictures may show either.
    this.video.currentTime = Math.min(((angle % 360) / 360) * duration + 0.5 / Number(this.slider.dataset.pace), duration);
    this.show(angle);
  }

  show(angle) {
    const step = Number(this.slider.step);
    const pictures = Math.round(360 / step);
    const picture = (Math.floor(angle / step + 1e-6) % pictures) + 1;
    this.slider.value = angle;
    this.output.value = `${picture} / ${pictures}`;
    this.slider.setAttribute("aria-valuetext", `picture ${picture} of ${pictures}`);
  }

  follow() {
    if (this.video.paused) return;
    this.show((360 * this.video.currentTime) / (this.video.duration || 1));
    requestAnimationFrame(() => this.follow());
  }

  drag(down) {
    const start = Number(this.slider.value);
    const width = this.stage.clientWidth;
    this.stage.setPointerCapture(down.pointerId);
    const move = (event) => this.turnTo((((start + (360 * (event.clientX - down.clientX)) / width) % 360) + 360) % 360);
    this.stage.addEventListener("pointermove", move);
    const end = () => this.stage.removeEventListener("pointermove", move);
    this.stage.addEventListener("pointerup", end, { once: true });
    this.stage.addEventListener("pointercancel", end, { once: true });
  }
}

const players = new Map();
for (const turn of document.querySelectorAll(".turn:has(video)")) players.set(turn, new Player(turn));

const seen = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    const player = players.get(entry.target);
    player.inView = entry.isIntersecting;
    player.update();
  }
}, { threshold: 0.2 });
for (const turn of players.keys()) seen.observe(turn);

for (const item of document.querySelectorAll(".item")) {
  const choice = item.querySelector(".turns");
  if (!choice) continue;
  const turns = [...item.querySelectorAll(".turn")];
  const show = (index) => turns.forEach((turn, place) => {
    turn.hidden = place !== index;
    players.get(turn)?.update();
  });
  choice.hidden = false;
  choice.addEventListener("change", (event) => show(Number(event.target.value)));
  show(Number(choice.querySelector("input:checked").value)); // a browser that comes back remembers the choice
}
