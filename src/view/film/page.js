"use strict";
// Plays the episodes of one recording, or of two side by side. `docs/formats.md` describes the data.
const films = JSON.parse(document.getElementById("data").textContent).films;
const byId = (id) => document.getElementById(id);
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const numbers = (text, kind) => new kind(bytes(text).buffer);
const NONE = -32768, LATE = 254, LOST = 255, THERE = [0, 3];

for (const film of films) {
  for (const episode of film.episodes) {
    episode.places = Float32Array.from(numbers(episode.places, Int16Array), (value) => value * film.unit);
    const targets = episode.targets ? numbers(episode.targets, Int16Array) : [];
    episode.targets = Float32Array.from(targets, (value) => value * film.unit);
    episode.ghosts = episode.ghosts && numbers(episode.ghosts, Int16Array);
    episode.links = episode.links && bytes(episode.links);
    episode.presence = episode.presence && bytes(episode.presence);
    episode.returns = numbers(episode.returns, Float32Array);
    episode.errors = episode.errors && numbers(episode.errors, Float32Array);
  }
}

const dark = matchMedia("(prefers-color-scheme: dark)");
const still = matchMedia("(prefers-reduced-motion: reduce)");
const LIGHT_AGENTS = ["#0072b2", "#d55e00", "#007a59", "#a0447c", "#444444", "#6b7580", "#3a7fae"];
const DARK_AGENTS = ["#56b4e9", "#e69f00", "#2fc99c", "#cc79a7", "#f0e442", "#9aa4ae", "#e07a5f"];
const TRAIL = 10;

// What is shown.
const now = { episode: 0, time: 0, playing: false, speed: 1, agent: films[0].viewer };
const shows = (what) => byId(what).checked;
const all = () => films.map((film) => film.episodes[now.episode]);
const end = () => Math.max(...all().map((episode) => episode.steps));
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
const colour = (agent) => (dark.matches ? DARK_AGENTS : LIGHT_AGENTS)[agent % LIGHT_AGENTS.length];

/** A canvas at the resolution of the screen, and its size in CSS pixels. */
function prepare(canvas) {
  const { width, height } = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
  const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== wide || canvas.height !== high) [canvas.width, canvas.height] = [wide, high];
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

/** What of the plane is seen: everything that is anywhere in these episodes. */
function extent(episodes) {
  let [left, right, low, high] = [-1, 1, -1, 1];
  for (const { places, landmarks, targets } of episodes) {
    for (const all of [places, landmarks.flat(), targets]) {
      for (let at = 0; at < all.length; at += 2) {
        [left, right] = [Math.min(left, all[at]), Math.max(right, all[at])];
        [low, high] = [Math.min(low, all[at + 1]), Math.max(high, all[at + 1])];
      }
    }
  }
  const half = 0.56 * Math.max(right - left, high - low);
  return { x: (left + right) / 2, y: (low + high) / 2, half };
}

/** Where one of those whose places these are is at a time between two steps. */
function between(places, episode, one, time) {
  const step = Math.min(Math.floor(time), episode.steps), next = Math.min(step + 1, episode.steps);
  const part = still.matches ? 0 : Math.min(time, episode.steps) - step;
  const at = (step) => 2 * ((step * places.length) / 2 / (episode.steps + 1) + one);
  return [0, 1].map((axis) => (1 - part) * places[at(step) + axis] + part * places[at(next) + axis]);
}

/** Where an agent is at a time between two steps. */
const place = (film, episode, agent, time) => between(episode.places, episode, agent, time);

/** The last step that was decided. */
const decided = (episode, time) => Math.min(Math.floor(time), episode.steps - 1);
const isThere = (film, episode, step, agent) =>
  !episode.presence || THERE.includes(episode.presence[step * film.agents.length + agent]);

function drawStage(film, episode, canvas) {
  const { pen, width, height } = prepare(canvas), view = extent(all());
  const scale = Math.min(width, height) / 2 / view.half;
  const screen = ([x, y]) => [width / 2 + (x - view.x) * scale, height / 2 - (y - view.y) * scale];
  const size = Math.max(7, 0.06 * scale), step = decided(episode, now.time);
  const agents = film.agents.map((_, agent) => screen(place(film, episode, agent, now.time)));
  const stroke = (points, ink, wide, dash = [], alpha = 1) => {
    pen.save();
    [pen.strokeStyle, pen.lineWidth, pen.globalAlpha] = [ink, wide, alpha];
    pen.setLineDash(dash);
    pen.beginPath();
    points.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
    pen.restore();
  };
  const disc = ([x, y], radius, ink, fills, dash = []) => {
    pen.beginPath();
    pen.arc(x, y, radius, 0, 7);
    pen.setLineDash(dash);
    [pen.fillStyle, pen.strokeStyle, pen.lineWidth] = [ink, ink, 2];
    fills ? pen.fill() : pen.stroke();
    pen.setLineDash([]);
  };
  const word = (text, [x, y], ink) => {
    [pen.fillStyle, pen.textAlign, pen.textBaseline] = [ink, "center", "middle"];
    pen.font = `600 ${Math.max(10, size)}px system-ui, sans-serif`;
    pen.fillText(text, x, y);
  };

  // Few lines, however far all goes.
  let apart = 0.5;
  while (view.half / apart > 12) apart *= 2;
  for (let line = Math.ceil((view.x - view.half) / apart) * apart; line < view.x + view.half; line += apart) {
    const [x] = screen([line, 0]);
    stroke([[x, 0], [x, height]], style("--line"), line ? 0.5 : 1);
  }
  for (let line = Math.ceil((view.y - view.half) / apart) * apart; line < view.y + view.half; line += apart) {
    const [, y] = screen([0, line]);
    stroke([[0, y], [width, y]], style("--line"), line ? 0.5 : 1);
  }
  episode.landmarks.forEach((landmark, index) => {
    const [x, y] = screen(landmark), ink = style("--soft"), arm = 0.7 * size;
    stroke([[x - arm, y - arm], [x + arm, y + arm]], ink, 2.5);
    stroke([[x - arm, y + arm], [x + arm, y - arm]], ink, 2.5);
    if (index === episode.goal) disc([x, y], 1.4 * size, style("--ink"), false);
  });
  for (let target = 0; target < episode.targets.length / 2 / (episode.steps + 1); target++) {
    const [x, y] = screen(between(episode.targets, episode, target, now.time));
    const corners = [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]];
    stroke(corners.map(([right, down]) => [x + size * right, y + size * down]), style("--ink"), 2.5);
  }
  if (shows("trails")) {
    agents.forEach((_, agent) => {
      for (let back = 0; back < TRAIL; back++) {
        const [from, to] = [now.time - back - 1, now.time - back];
        if (to <= 0) break;
        const points = [Math.max(from, 0), to].map((time) => screen(place(film, episode, agent, time)));
        stroke(points, colour(agent), 2.5, [], 0.55 * (1 - back / TRAIL));
      }
    });
  }
  if (shows("links") && episode.links) {
    agents.forEach((receiver, i) => {
      if (now.agent >= 0 && now.agent !== i) return;
      agents.forEach((sender, j) => {
        if (i === j || !isThere(film, episode, step, i) || !isThere(film, episode, step, j)) return;
        const age = episode.links[(step * agents.length + i) * agents.length + j];
        // Of two that face each other, each has the half at its own end.
        const middle = [0, 1].map((axis) => (receiver[axis] + sender[axis]) / 2);
        const from = now.agent === i ? sender : middle;
        if (age === LOST) stroke([from, receiver], style("--lost"), 1.5, [2, 6], 0.6);
        else if (age === LATE) stroke([from, receiver], style("--late"), 2, [8, 4, 2, 4], 0.9);
        else stroke([from, receiver], style("--here"), 2.2, age ? [9, 4] : [], 0.85);
        if (age > 0 && age < LATE) word(String(age), middle, style("--here"));
      });
    });
  }
  if (shows("ghosts") && episode.ghosts && now.agent >= 0) {
    agents.forEach((agent, j) => {
      const at = 2 * ((step * agents.length + now.agent) * agents.length + j);
      if (episode.ghosts[at] === NONE) return;
      const ghost = screen([episode.ghosts[at] * film.unit, episode.ghosts[at + 1] * film.unit]);
      stroke([agent, ghost], colour(j), 1, [1, 3], 0.8);
      pen.globalAlpha = 0.85;
      disc(ghost, size, colour(j), false, [4, 3]);
      word(String(j), ghost, colour(j));
      pen.globalAlpha = 1;
    });
  }
  agents.forEach((agent, index) => {
    const there = isThere(film, episode, step, index);
    disc(agent, size, there ? colour(index) : style("--stage"), true);
    if (!there) disc(agent, size, colour(index), false, [3, 3]);
    word(String(index), agent, there ? (dark.matches ? "#0d1117" : "#fff") : colour(index));
    if (index === now.agent) disc(agent, size + 4, style("--ink"), false);
  });
}

/** A number in a few digits. */
const short = (value) => (Math.abs(value) < 100 ? Number(value.toPrecision(3)) : Math.round(value)).toString();

/** The curve of an error: that of the chosen agent, or of the team. NaN where nothing was imputed. */
function error(film, episode, step) {
  const team = film.agents.length, of = (agent) => episode.errors[step * team + agent];
  if (now.agent >= 0) return of(now.agent);
  const known = film.agents.map((_, agent) => of(agent)).filter((value) => !Number.isNaN(value));
  return known.length ? Math.sqrt(known.reduce((sum, value) => sum + value * value, 0) / known.length) : NaN;
}

function drawCurves() {
  const { pen, width, height } = prepare(byId("curves")), last = end();
  const [left, right, gap] = [58, 12, 26], episodes = all();
  const panels = [["return", (film, episode, step) => episode.returns[step], 0]];
  if (episodes.some((episode) => episode.errors)) {
    panels.push(["imputation error", (film, episode, step) =>
      episode.errors && step < episode.steps ? error(film, episode, step) : NaN, 1]);
  }
  const high = (height - gap * (panels.length + 0.4)) / panels.length;
  const x = (time) => left + (time / last) * (width - left - right);
  pen.font = "12px system-ui, sans-serif";
  panels.forEach(([name, value, row]) => {
    const top = gap + row * (high + gap);
    const curves = films.map((film, index) =>
      Array.from({ length: episodes[index].steps + 1 }, (_, step) => value(film, episodes[index], step)));
    const known = [0, ...curves.flat().filter((value) => !Number.isNaN(value))];
    let [low, most] = [Math.min(...known), Math.max(...known)];
    if (low === most) most = low + 1;
    const y = (value) => top + (1 - (value - low) / (most - low)) * high;
    [pen.strokeStyle, pen.lineWidth] = [style("--line"), 1];
    pen.strokeRect(left, top, width - left - right, high);
    [pen.fillStyle, pen.textAlign] = [style("--soft"), "right"];
    pen.fillText(short(most), left - 6, top + 10);
    pen.fillText(short(low), left - 6, top + high);
    pen.textAlign = "left";
    pen.fillText(name, left, top - 7);
    curves.forEach((curve, index) => {
      [pen.strokeStyle, pen.lineWidth] = [colour(index), 2];
      pen.setLineDash(index ? [7, 4] : []);
      pen.beginPath();
      let draws = false;
      curve.forEach((value, step) => {
        if (!Number.isNaN(value)) draws ? pen.lineTo(x(step), y(value)) : pen.moveTo(x(step), y(value));
        draws = !Number.isNaN(value);
      });
      pen.stroke();
      pen.setLineDash([]);
    });
  });
  [pen.strokeStyle, pen.lineWidth] = [style("--ink"), 1];
  pen.beginPath();
  pen.moveTo(x(now.time), gap);
  pen.lineTo(x(now.time), height - 0.4 * gap);
  pen.stroke();
}

/** What the pictures show, in words. */
function told(film, episode) {
  const step = decided(episode, now.time), shown = Math.min(Math.floor(now.time), episode.steps);
  const words = [`step ${shown} of ${episode.steps}`, `return ${episode.returns[shown].toFixed(1)}`];
  if (episode.errors && !Number.isNaN(error(film, episode, step))) {
    words.push(`imputation error ${error(film, episode, step).toFixed(3)}`);
  }
  if (now.agent >= 0 && episode.links) {
    const team = film.agents.length, from = (step * team + now.agent) * team;
    const ages = [...episode.links.slice(from, from + team)].filter((_, sender) => sender !== now.agent);
    const heard = ages.filter((age) => age < LATE).length;
    words.push(isThere(film, episode, step, now.agent)
      ? `agent ${now.agent} hears ${heard} of ${team - 1}` : `agent ${now.agent} does not decide`);
  }
  return words.join(", ");
}

function draw() {
  films.forEach((film, index) => {
    const canvas = byId(`stage-${index}`), words = told(film, all()[index]);
    drawStage(film, all()[index], canvas);
    canvas.setAttribute("aria-label", `${film.name}: ${words}`);
    byId(`told-${index}`).textContent = words;
  });
  drawCurves();
  const step = Math.floor(now.time);
  [byId("step").max, byId("step").value] = [end(), step];
  byId("step").setAttribute("aria-valuetext", `step ${step} of ${end()}`);
  byId("clock").textContent = `${(now.time * films[0].dt).toFixed(1)} of ${(end() * films[0].dt).toFixed(1)} s`;
}

function say() {
  byId("said").textContent = films.map((film, index) => `${film.name}: ${told(film, all()[index])}`).join("; ");
}

function seek(time) {
  now.time = Math.min(Math.max(time, 0), end());
  draw();
}

function setPlaying(playing) {
  if (playing && now.time >= end()) now.time = 0;
  now.playing = playing;
  byId("play").textContent = playing ? "Pause" : "Play";
  if (playing) {
    now.before = undefined;
    requestAnimationFrame(advance);
  } else {
    say();
  }
}

function advance(at) {
  if (!now.playing) return;
  // A page that was hidden goes on where it was.
  const passed = Math.min(at - (now.before ?? at), 100) / 1000;
  now.before = at;
  seek(now.time + (passed * now.speed) / films[0].dt);
  if (now.time >= end()) setPlaying(false);
  else requestAnimationFrame(advance);
}

/** Goes by so many steps, and stands still there. */
function go(steps) {
  setPlaying(false);
  seek(Math.floor(now.time) + steps);
  say();
}

function choose(id, by) {
  const list = byId(id), to = list.selectedIndex + by;
  if (to < 0 || to >= list.options.length) return;
  list.selectedIndex = to;
  list.dispatchEvent(new Event("change"));
}

byId("play").onclick = () => setPlaying(!now.playing);
byId("back").onclick = () => go(-1);
byId("forward").onclick = () => go(1);
byId("step").oninput = () => { setPlaying(false); seek(Number(byId("step").value)); };
byId("speed").onchange = () => { now.speed = Number(byId("speed").value); };
byId("episode").onchange = () => { now.episode = byId("episode").selectedIndex; seek(0); say(); };
byId("agent").onchange = () => { now.agent = Number(byId("agent").value); draw(); say(); };
for (const what of ["ghosts", "links", "trails"]) byId(what).onchange = draw;

const scrub = (event) => {
  if (event.buttons !== 1) return;
  const box = byId("curves").getBoundingClientRect();
  setPlaying(false);
  seek(((event.clientX - box.left - 58) / (box.width - 70)) * end());
};
byId("curves").onpointerdown = scrub;
byId("curves").onpointermove = scrub;

const KEYS = {
  " ": () => setPlaying(!now.playing),
  ArrowLeft: () => go(-1),
  ArrowRight: () => go(1),
  Home: () => go(-now.time),
  End: () => go(end()),
  n: () => choose("episode", 1),
  b: () => choose("episode", -1),
  a: () => choose("agent", byId("agent").selectedIndex + 1 < byId("agent").options.length ? 1 : -byId("agent").selectedIndex),
  "+": () => choose("speed", 1),
  "-": () => choose("speed", -1),
  g: () => byId("ghosts").click(),
  l: () => byId("links").click(),
  t: () => byId("trails").click(),
};
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.defaultPrevented) return;
  // What has the focus keeps the keys that are its own.
  const { tagName, type } = event.target;
  if (tagName === "SELECT" || (tagName === "BUTTON" && event.key === " ") || type === "checkbox" && event.key === " ") return;
  if (tagName === "SUMMARY" && event.key === " ") return;
  const act = KEYS[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});

const one = films[0];
byId("agent").value = String(now.agent);
byId("ghosts").parentElement.hidden = !films.some((film) => film.episodes.some((episode) => episode.ghosts));
byId("links").parentElement.hidden = !films.some((film) => film.episodes.some((episode) => episode.links));
if (one.episodes.length < 2) byId("episode").parentElement.hidden = true;
dark.addEventListener("change", draw);
new ResizeObserver(draw).observe(document.querySelector("main"));
draw();
