// The player: one group, its futures in time.

const shared = documentOf("shared-data");
const dialog = document.getElementById("player");
const byId = (id) => document.getElementById(id);
const STRIDE_TICKS = 5;

/** An element with text and attributes; text of a dataset is text alone. */
function made(name, text = "", attributes = {}) {
  const element = document.createElement(name);
  element.textContent = text;
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

function swatch(index) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 11");
  svg.setAttribute("class", "swatch");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", "M0 5.5h24");
  path.setAttribute("class", `c${index}`);
  path.setAttribute("stroke-dasharray", DASHES[shared.bank[index].family % DASHES.length].join(" "));
  svg.append(path);
  return svg;
}

const towns = new Map();
function roadsOf(town) {
  if (!towns.has(town)) {
    const packed = shared.towns[town];
    towns.set(town, packed ? roadPaths(decodedTown({ ...packed, step_m: shared.steps.road_m }).map((element) => ({
      ...element, x: element.x.map((x) => x + packed.at[0]), y: element.y.map((y) => y + packed.at[1]),
    }))) : null);
  }
  return towns.get(town);
}

const player = {
  group: null, place: -1, mode: "one", tick: 0, isPlaying: false, zoom: 1, pan: [0, 0], follow: false,
  hiddenFamilies: new Set(), a: 0, b: 0, spot: null, opener: null, leaveTo: null,
};
const maps = [new MapView(byId("map-a")), new MapView(byId("map-b"))];
const goTo = (tick) => {
  player.tick = Math.max(HISTORY_TICK, Math.min(HORIZON_TICK, tick));
  redraw();
};
const charts = ["speed", "gap", "controls"].map((name) => new Chart(byId(`chart-${name}`), goTo));
const candidate = (future) => shared.bank.findIndex((one) => one.key === future.key);
const inkOf = (future) => ink(`c${candidate(future)}`);
const dashOf = (future) => DASHES[shared.bank[candidate(future)].family % DASHES.length];
const isFamilyShown = (future) => !player.hiddenFamilies.has(shared.bank[candidate(future)].family);

/** Futures in the foreground, by the mode. */
function chosenFutures() {
  const { futures } = player.group;
  const one = (place) => futures[Math.min(place, futures.length - 1)];
  if (player.mode === "one") return [one(player.a)];
  if (player.mode === "two") return [one(player.a), one(player.b)];
  return futures.filter(isFamilyShown);
}

function redraw() {
  if (player.group === null || !dialog.open) return;
  const { group, mode, tick } = player;
  byId("time").value = tick;
  byId("time").setAttribute("aria-valuetext", timeText(tick));
  byId("time-text").textContent = timeText(tick);
  if (group.futures.length === 0) return;
  const chosen = chosenFutures();
  const shown = group.futures.filter(isFamilyShown);
  const look = {
    mode, tick, shown, nominal: group.futures[0], zoom: player.zoom, pan: player.pan, follow: player.follow, ink: inkOf,
    frame: group.frame,
  };
  maps.slice(0, mode === "two" ? 2 : 1).forEach((map, i) => {
    const own = mode === "two" ? [chosen[i]] : chosen;
    const others = mode === "two" ? [] : shown;
    const spots = spotsOf(group, own);
    map.draw(group, roadsOf(group.town), { ...look, chosen: own, shown: others, spots, spot: player.spot });
    const names = mode === "all" ? "All candidates" : nameOf(own[0]);
    map.figure.querySelector("span").textContent = names;
    map.figure.querySelector("output").textContent = mode === "all" ? "" : stateText(own[0], tick);
    map.canvas.setAttribute("aria-label", `Map at ${timeText(tick)}: ${names}; ${group.remarkText}`);
  });
  const spots = spotsOf(group, chosen);
  drawTimeMarks(spots, player.spot, chooseSpot);
  drawCharts(chosen, shown, tick, spots);
  drawCameras(chosen, tick);
}

function nameOf(future) {
  return shared.bank[candidate(future)].label;
}

function timeText(tick) {
  const part = tick < 0 ? "history" : tick <= 50 ? "intervention" : "recovery";
  return `${tick < 0 ? "−" : "+"}${Math.abs(tick / 20).toFixed(2)} s, ${part}`;
}

function numberText(value, digits, unit) {
  return Number.isFinite(value) ? `${value.toFixed(digits)}${unit}` : "unknown";
}

function stateText(future, tick) {
  if (tick > future.tick.at(-1)) return `ended at +${(future.tick.at(-1) / 20).toFixed(2)} s`;
  return `${numberText(valueAt(future.tick, future.speed, tick), 1, " m/s")}`;
}

function drawCharts(chosen, shown, tick, spots) {
  const isAll = player.mode === "all";
  const order = [...shown.filter((future) => !chosen.includes(future)), ...[...chosen].reverse()];
  const lines = (name) => order.map((future) => ({
    tick: future.tick, values: future[name], colour: inkOf(future), dash: dashOf(future),
    width: chosen.includes(future) && !isAll ? 2.6 : isAll ? 1.5 : 1.1,
    alpha: chosen.includes(future) ? 1 : 0.45,
    contacts: chosen.includes(future) ? contactRows(future) : [],
  }));
  const marks = spots.filter((spot) => spot.tick !== null && isInTime(spot.tick)).map((spot) => ({ tick: spot.tick, isChosen: spot === player.spot }));
  charts[0].draw(lines("speed"), null, tick, marks);
  charts[1].draw(lines("gap"), null, tick, marks);
  const main = isAll ? chosen.slice(0, 1) : chosen;
  byId("controls-title").textContent = main.length
    ? `${isAll ? nameOf(main[0]) : "Commands"}: steering (solid, right is positive), throttle (dashed), brake (dotted)`
    : "Commands";
  charts[2].draw(
    main.flatMap((future) => future.commands.map((values, i) => ({
      tick: future.commandTick, values, colour: inkOf(future), dash: [[], [7, 3], [2, 2.5]][i], width: 1.8,
    }))),
    [-1.05, 1.05], tick, marks,
  );
  const said = (name, digits, unit) => (isAll ? "" : chosen.map((future) => numberText(valueAt(future.tick, future[name], tick), digits, unit)).join(" · "));
  charts[0].output.textContent = said("speed", 1, " m/s");
  charts[1].output.textContent = said("gap", 1, " m");
  charts[2].output.textContent = main.map((future) => future.commands.map((values) => numberText(valueAt(future.commandTick, values, tick), 2, "")).join(" / ")).join(" · ");
  for (const [chart, name] of charts.map((chart, i) => [chart, ["Speed", "Gap", "Commands"][i]])) {
    chart.canvas.setAttribute("aria-label", `${name} over time at ${timeText(tick)}: ${chart.output.textContent || "all candidates"}`);
  }
}

/** Images of the chosen candidate nearest in time; before the branch those of the nominal, which all share. */
function drawCameras(chosen, tick) {
  const images = player.group.images ?? [];
  byId("camera-part").hidden = player.group.images === undefined;
  byId("camera-text").textContent = player.group.image_text ?? "";
  const nominal = player.group.futures[0].key;
  const wanted = tick <= 0 ? nominal : chosen[0]?.key ?? nominal;
  const holder = byId("cameras");
  const parts = [];
  for (const camera of new Set(images.map((image) => image.camera))) {
    const own = images.filter((image) => image.camera === camera && (image.key === wanted || (image.key === nominal && image.tick <= 0)));
    if (own.length === 0) continue;
    const best = own.reduce((a, b) => (Math.abs(a.tick - tick) <= Math.abs(b.tick - tick) ? a : b));
    parts.push({ camera, best });
  }
  const state = parts.map(({ best }) => images.indexOf(best)).join();
  if (holder.dataset.state === state) return;
  holder.dataset.state = state;
  holder.replaceChildren(...parts.map(({ camera, best }) => {
    const figure = made("figure");
    const owner = shared.bank.find((one) => one.key === best.key)?.label ?? "";
    const image = made("img", "", { alt: `Camera ${camera} of ${owner} at ${timeText(best.tick)}` });
    image.src = best.uri;
    figure.append(image, made("figcaption", `${camera}, ${(best.tick / 20).toFixed(2)} s, ${owner}`));
    return figure;
  }));
}

function fillChoices() {
  const { group } = player;
  for (const id of ["candidate-a", "candidate-b"]) {
    byId(id).replaceChildren(...group.futures.map((future, place) => made("option", `${nameOf(future)}${faultsText(place)}`, { value: place })));
  }
  player.a = Math.min(player.a, group.futures.length - 1);
  if (player.b >= group.futures.length || player.b === player.a) player.b = group.futures.length > 1 ? 1 : 0;
  byId("candidate-a").value = player.a;
  byId("candidate-b").value = player.b;
  const families = new Map();
  for (const future of group.futures) {
    const { family } = shared.bank[candidate(future)];
    if (!families.has(family)) families.set(family, []);
    families.get(family).push(candidate(future));
  }
  byId("families").replaceChildren(byId("families").firstElementChild, ...[...families].map(([family, members]) => {
    const label = made("label");
    const box = made("input", "", { type: "checkbox", value: family });
    box.checked = !player.hiddenFamilies.has(family);
    box.addEventListener("change", () => {
      if (box.checked) player.hiddenFamilies.delete(family);
      else player.hiddenFamilies.add(family);
      redraw();
    });
    label.append(box, " ", swatch(members.at(-1)), ` ${shared.families[family]}`);
    return label;
  }));
  fillLegend();
  fillOutcomes();
}

function faultsText(place) {
  const num = numFaults(player.group, place);
  return num ? ` (fails ${num} ${num > 1 ? "rules" : "rule"})` : "";
}

function fillLegend() {
  const present = new Set(player.group.futures.flatMap((future) => [...future.tracks.values()].map((track) => track.kind)));
  const entries = [...present].sort().map((kind) => {
    const entry = made("li");
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", "0 0 22 14");
    svg.setAttribute("aria-hidden", "true");
    const rect = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    for (const [key, value] of Object.entries({ x: 1, y: 1, width: 20, height: 12, class: `actor ${ACTOR_INKS[kind]}` })) rect.setAttribute(key, value);
    svg.append(rect);
    entry.append(svg, ACTOR_NAMES[kind]);
    return entry;
  });
  byId("legend").replaceChildren(...entries, made("li", "× a touch begins"), made("li", "dashed: the route"),
    ...(player.group.spots.length ? [made("li", "◇ ▽ places of findings"), made("li", "◎ an actor that a finding names")] : []),
    made("li", "in “all”, outlines are actors that a candidate moves otherwise"));
}

function fillOutcomes() {
  document.querySelector(".outcomes .fails").hidden = player.group.faults.length === 0;
  byId("outcomes").replaceChildren(...player.group.futures.map((future, place) => {
    const row = made("tr");
    const name = made("th", "", { scope: "row" });
    name.append(swatch(candidate(future)), ` ${nameOf(future)}`);
    const ahead = future.tick.map((tick, i) => i).filter((i) => future.tick[i] > 0 && future.tick[i] <= 50);
    const gaps = ahead.map((i) => future.gap[i]).filter(Number.isFinite);
    const least = ahead.some((i) => future.touched[i]) ? 0 : gaps.length ? Math.min(...gaps) : NaN;
    const [touch] = contactRows(future);
    const end = future.tick.at(-1);
    const touchText = touch !== undefined ? `+${(future.tick[touch] / 20).toFixed(2)} s` : end < HORIZON_TICK ? `none to +${(end / 20).toFixed(2)} s` : "none";
    row.append(
      name, made("td", Number.isFinite(least) ? `${least.toFixed(1)} m` : "–", { class: "number" }),
      made("td", ahead.length ? numberText(future.speed[ahead.at(-1)], 1, " m/s") : "–", { class: "number" }),
      made("td", touchText, { class: touch === undefined ? "number" : "number touches" }),
    );
    if (player.group.faults.length) row.append(made("td", numFaults(player.group, place) || "–", { class: "number" }));
    row.dataset.place = place;
    return row;
  }));
  markChosen();
}

function markChosen() {
  const wanted = player.mode === "all" ? [] : player.mode === "one" ? [player.a] : [player.a, player.b];
  for (const row of byId("outcomes").children) row.classList.toggle("chosen", wanted.includes(Number(row.dataset.place)));
}

function choiceChanged() {
  const isTwo = player.mode === "two";
  byId("stage").classList.toggle("two", isTwo);
  byId("map-b").hidden = !isTwo;
  byId("pick-b").hidden = !isTwo;
  byId("candidate-a").disabled = player.mode === "all";
  for (const radio of document.getElementsByName("mode")) radio.checked = radio.value === player.mode;
  markChosen();
  markSpot();
  redraw();
}

/** Show the place of a finding: its candidate, and its time as far as that is shown. */
function chooseSpot(spot) {
  const future = player.group.futures[spot.future];
  player.spot = spot;
  player.hiddenFamilies.delete(shared.bank[candidate(future)].family);
  if (player.mode === "all") player.mode = "one";
  if (player.mode === "one" || player.b !== spot.future) player.a = spot.future;
  setPlaying(false);
  if (spot.tick !== null) player.tick = Math.max(HISTORY_TICK, Math.min(HORIZON_TICK, spot.tick));
  fillChoices();
  choiceChanged();
  byId("stage").scrollIntoView({ block: "nearest" });
}

/** Go some places on in the list of what is wrong. */
function stepSpot(by) {
  const spots = player.group.spots;
  if (spots.length === 0) return;
  const at = spots.indexOf(player.spot);
  chooseSpot(spots[at < 0 ? (by > 0 ? 0 : spots.length - 1) : (at + by + spots.length) % spots.length]);
}

function markSpot() {
  const { spot, group } = player;
  for (const { button } of group.spots) button.setAttribute("aria-pressed", String(button === spot?.button));
  byId("spot-text").textContent = spot === null ? "" : `${spot.rule}, ${spotText(spot, group)}${spot.text ? `: ${spot.text}` : ""}`;
}

/** Close the player and go to a place of the report. */
function leaveTo(event, id) {
  event.preventDefault();
  player.leaveTo = id;
  dialog.close();
}

/** Open a group of the page, at a place of a finding where one is named. */
function openGroup(place, rule, number) {
  const packed = documentOf(`group-data-${place}`);
  if (packed === null) return;
  const group = packed.data === undefined ? { ...packed, futures: [] } : decodedGroup(packed, shared.steps);
  group.faults = decodedFaults(packed);
  group.spots = group.faults.flatMap((fault) => fault.spots).filter((spot) => spot.future >= 0);
  group.remarkText = group.remarks.length ? `${group.remarks.length} remarks on what is not drawn` : "everything recorded is drawn";
  if (group.futures.length) group.frame = frameOf(group);
  Object.assign(player, { group, place, tick: 0, isPlaying: false, zoom: 1, pan: [0, 0], spot: null });
  byId("player-title").textContent = group.name;
  byId("player-facts").textContent = group.about;
  byId("player-remarks").replaceChildren(...group.remarks.map((text) => made("li", text)));
  byId("player-remarks").hidden = group.remarks.length === 0;
  byId("player-whole").hidden = group.futures.length === 0;
  byId("play").textContent = "Play";
  byId("cameras").dataset.state = "none";
  byId("previous-group").disabled = place === 0;
  byId("next-group").disabled = document.getElementById(`group-data-${place + 1}`) === null;
  fillFaults(group, chooseSpot, leaveTo);
  const begins = !dialog.open;
  if (begins) dialog.showModal();
  // Space plays at once, and what is hidden takes no keys.
  if (begins || byId("player-whole").hidden) byId(group.futures.length ? "play" : "close-player").focus({ preventScroll: true });
  if (group.futures.length) {
    byId("spot-text").after(byId("faults"));
    fillChoices();
  } else byId("player-remarks").after(byId("faults"));
  const spot = group.faults.find((fault) => fault.rule === rule)?.spots[number];
  if (spot === undefined || spot.future < 0) {
    choiceChanged();
    return;
  }
  chooseSpot(spot);
  spot.button.closest("details")?.setAttribute("open", "");
  spot.button.focus({ preventScroll: true });
}

/** Open what an address such as `#play-3` or `#play-3-BD-EVD-001-0` names; whether it names something. */
function openAddress(hash) {
  const asked = /^#play-(\d+)(?:-(BD-[A-Z]{3}-\d{3})-(\d+))?$/.exec(hash);
  if (asked === null) return false;
  openGroup(Number(asked[1]), asked[2], Number(asked[3]));
  return true;
}

function setPlaying(isPlaying) {
  player.isPlaying = isPlaying;
  byId("play").textContent = isPlaying ? "Pause" : "Play";
  if (!isPlaying) return;
  if (player.tick >= HORIZON_TICK) player.tick = 0;
  let before = performance.now();
  const step = (now) => {
    if (!player.isPlaying || !dialog.open) return;
    const tick = player.tick + ((now - before) / 50) * Number(byId("pace").value);
    before = now;
    goTo(tick);
    if (tick >= HORIZON_TICK) setPlaying(false);
    else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

const zoom = (factor) => {
  player.zoom = Math.max(0.2, Math.min(20, player.zoom * factor));
  redraw();
};
const move = (right, down) => {
  player.pan = [player.pan[0] + right, player.pan[1] + down];
  redraw();
};
const setMode = (mode) => {
  player.mode = mode;
  choiceChanged();
};

for (const button of document.querySelectorAll("button.open")) {
  button.addEventListener("click", () => {
    player.opener = button;
    openGroup(Number(button.dataset.place));
  });
}
for (const link of document.querySelectorAll("a.play[href^='#']")) {
  link.addEventListener("click", (event) => {
    event.preventDefault();
    player.opener = link;
    openAddress(link.hash);
  });
}
byId("close-player").addEventListener("click", () => dialog.close());
dialog.addEventListener("close", () => {
  setPlaying(false);
  const target = player.leaveTo === null ? null : byId(player.leaveTo);
  const opener = player.opener ?? document.querySelector(`button.open[data-place="${player.place}"]`);
  Object.assign(player, { leaveTo: null, opener: null });
  if (target === null) opener?.focus();
  else {
    if (target.tagName === "DETAILS") target.open = true;
    target.scrollIntoView();
    target.querySelector("a, summary")?.focus({ preventScroll: true });
  }
});
byId("previous-group").addEventListener("click", () => openGroup(player.place - 1));
byId("next-group").addEventListener("click", () => openGroup(player.place + 1));
byId("previous-fault").addEventListener("click", () => stepSpot(-1));
byId("next-fault").addEventListener("click", () => stepSpot(1));
byId("play").addEventListener("click", () => setPlaying(!player.isPlaying));
byId("time").addEventListener("input", (event) => {
  setPlaying(false);
  goTo(Number(event.target.value));
});
byId("zoom-in").addEventListener("click", () => zoom(1.25));
byId("zoom-out").addEventListener("click", () => zoom(0.8));
byId("follow").addEventListener("change", (event) => {
  Object.assign(player, { follow: event.target.checked, pan: [0, 0] });
  redraw();
});
for (const [id, name] of [["candidate-a", "a"], ["candidate-b", "b"]]) {
  byId(id).addEventListener("change", (event) => {
    player[name] = Number(event.target.value);
    choiceChanged();
  });
}
for (const radio of document.getElementsByName("mode")) radio.addEventListener("change", () => setMode(radio.value));
for (const { canvas } of maps) {
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => event.buttons && move(event.movementX, event.movementY));
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.1 : 1 / 1.1);
  }, { passive: false });
}

const keys = {
  " ": () => setPlaying(!player.isPlaying),
  ArrowLeft: (event) => (event.shiftKey ? move(40, 0) : goTo((Math.ceil(player.tick / STRIDE_TICKS) - 1) * STRIDE_TICKS)),
  ArrowRight: (event) => (event.shiftKey ? move(-40, 0) : goTo((Math.floor(player.tick / STRIDE_TICKS) + 1) * STRIDE_TICKS)),
  ArrowUp: (event) => event.shiftKey && move(0, 40),
  ArrowDown: (event) => event.shiftKey && move(0, -40),
  Home: () => goTo(0),
  1: () => setMode("one"), 2: () => setMode("two"), 3: () => setMode("all"),
  "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8),
  f: (event) => stepSpot(event.shiftKey ? -1 : 1),
  n: () => byId("next-group").click(), p: () => byId("previous-group").click(),
};
dialog.addEventListener("keydown", (event) => {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (event.ctrlKey || event.metaKey || event.altKey || !(key in keys) || player.group === null) return;
  const { tagName, type } = event.target;
  const isOwn = tagName === "SELECT" || (type === "radio" && key.startsWith("Arrow")) || (type === "range" && (key.startsWith("Arrow") || key === "Home") && !event.shiftKey);
  if (isOwn || (key === " " && ["BUTTON", "INPUT", "SUMMARY"].includes(tagName) && type !== "range")) return;
  if ((key === "ArrowUp" || key === "ArrowDown") && !event.shiftKey) return;
  event.preventDefault();
  keys[key](event);
});
addEventListener("resize", redraw);
addEventListener("themechange", redraw);

// A page of one group opens it; in a report an address does.
if (!openAddress(location.hash) && document.body.dataset.opens !== undefined) openGroup(0);
addEventListener("hashchange", () => openAddress(location.hash));
