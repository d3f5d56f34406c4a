// The player: one group, its futures in time.

const shared = documentOf("shared-data");
const dialog = document.getElementById("player");
const byId = (id) => document.getElementById(id);

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
    const packed = Object.hasOwn(shared.towns, town) && shared.towns[town];  // a town may be called "constructor"
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
  player.tick = withinTime(tick);
  redraw();
};
const charts = ["speed", "gap", "controls"].map((name) => new Chart(byId(`chart-${name}`), goTo));
const candidate = (future) => shared.bank.findIndex((one) => one.key === future.key);
const inkOf = (future) => ink(`c${candidate(future)}`);
const dashOf = (future) => DASHES[shared.bank[candidate(future)].family % DASHES.length];
const isFamilyShown = (future) => !player.hiddenFamilies.has(shared.bank[candidate(future)].family);

/** The future that stands out, whatever the mode. */
const leadFuture = () => player.group.futures[player.a];

/** Futures in the foreground, by the mode. */
function chosenFutures() {
  const { futures } = player.group;
  if (player.mode === "one") return [leadFuture()];
  if (player.mode === "two") return [leadFuture(), futures[player.b]];
  return futures.filter((future) => isFamilyShown(future) || future === leadFuture());
}

function redraw() {
  if (player.group === null || !dialog.open) return;
  const { group, mode, tick } = player;
  if (group.futures.length === 0) return;
  byId("time").value = tick;
  byId("time").setAttribute("aria-valuetext", timeText(tick));
  byId("time-text").textContent = timeText(tick);
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
    const lead = mode === "all" ? leadFuture() : own[0];
    map.draw(group, roadsOf(group.town), { ...look, lead, chosen: own, shown: others, spots, spot: player.spot });
    const names = mode === "all" ? `All candidates, ${nameOf(lead)} filled` : nameOf(lead);
    map.figure.querySelector("span").textContent = names;
    map.figure.querySelector("output").textContent = stateText(lead, tick);
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
  return `${momentText(tick, leadFuture())}, ${part}`;
}

function numberText(value, digits, unit) {
  return Number.isFinite(value) ? `${value.toFixed(digits)}${unit}` : "unknown";
}

function stateText(future, tick) {
  if (tick < future.tick[0]) return `shown from ${momentText(future.tick[0], future)}`;
  if (tick > future.tick.at(-1)) return `ended at ${momentText(future.tick.at(-1), future)}`;
  return `${numberText(valueAt(future.tick, future.speed, tick), 1, " m/s")}`;
}

const SPEED = "speed_mps of observations";
const GAP = "separation_m of evidence";

function drawCharts(chosen, shown, tick, spots) {
  const isAll = player.mode === "all";
  const nominal = player.group.futures[0];
  const main = isAll ? [leadFuture()] : chosen;
  const order = [...new Set([...main, ...chosen, ...shown])].reverse();
  const lines = (name) => order.map((future) => ({
    tick: future.tick, values: future[name], colour: inkOf(future), dash: dashOf(future),
    width: main.includes(future) ? 2.6 : isAll ? 1.5 : 1.1,
    alpha: chosen.includes(future) ? 1 : 0.45,
    contacts: chosen.includes(future) ? contactRows(future) : [],
  }));
  const marks = spots.filter((spot) => spot.tick !== null && isInTime(spot.tick)).map((spot) => ({ tick: spot.tick, isChosen: spot === player.spot }));
  const hasDoubts = isDoubted(player.group, main, SPEED);
  const way = wayOf(main[0]);
  const drawnWay = hasDoubts ? [{ ...way, colour: ink("fault"), dash: [2, 2], width: 1.6 }] : [];
  byId("speed-title").textContent = `Speed, m/s${hasDoubts ? "; of the positions dotted" : ""}`;
  charts[0].draw([...lines("speed"), ...drawnWay], null, tick, marks);
  charts[1].draw(lines("gap"), null, tick, marks);
  // The second is drawn thin over the first, so that both are seen where they are alike.
  const commanded = player.mode === "two" || main[0] === nominal ? main : [...main, nominal];
  byId("controls-title").textContent =
    `Commands of ${commanded.map(nameOf).join(" and ")}: steering (solid, right is positive), throttle (dashed), brake (dotted)`;
  charts[2].draw(
    commanded.flatMap((future) => future.commands.map((values, i) => ({
      tick: future.commandTick, values, colour: inkOf(future), dash: [[], [7, 3], [2, 2.5]][i], width: future === main[0] ? 2.4 : 1.1,
    }))),
    [-1.05, 1.05], tick, marks,
  );
  const said = (name, digits, unit) => main.map((future) => numberText(valueAt(future.tick, future[name], tick), digits, unit)).join(" · ");
  const wayText = hasDoubts ? `, of the positions ${numberText(valueAt(way.tick, way.values, tick), 1, " m/s")}` : "";
  charts[0].output.textContent = said("speed", 1, " m/s") + wayText;
  charts[1].output.textContent = said("gap", 1, " m");
  const commandText = (future) => future.commands.map((values) => numberText(valueAt(future.commandTick, values, tick), 2, "")).join(" / ");
  charts[2].output.textContent = commanded.map((future) => `${main.includes(future) ? "" : "nominal "}${commandText(future)}`).join(" · ");
  for (const [chart, name] of charts.map((chart, i) => [chart, ["Speed", "Gap", "Commands"][i]])) {
    chart.canvas.setAttribute("aria-label", `${name} over time at ${timeText(tick)}: ${chart.output.textContent}`);
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
    figure.append(image, made("figcaption", `${camera}, ${momentText(best.tick, player.group.futures[0])}, ${owner}`));
    return figure;
  }));
}

function fillChoices() {
  const { group } = player;
  for (const id of ["candidate-a", "candidate-b"]) {
    byId(id).replaceChildren(...group.futures.map((future, place) => made("option", `${nameOf(future)}${faultsText(place)}`, { value: place })));
  }
  player.a = Math.min(player.a, group.futures.length - 1);
  if (player.b >= group.futures.length || player.b === player.a) player.b = player.a === 0 && group.futures.length > 1 ? 1 : 0;
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
    ...(player.group.spots.length ? [
      made("li", "◇ ▽ places of findings"), made("li", "◎ an actor that a finding names"),
      made("li", "dashed outline: before the branch, an actor of the nominal that this candidate lacks or has elsewhere"),
    ] : []),
    ...(player.group.futures.some((future) => future.tick.at(-1) < HORIZON_TICK) ? [made("li", "pale ego: where it was when its attempt ended")] : []),
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
    const isTouched = ahead.some((i) => future.touched[i]);
    const least = isTouched ? 0 : gaps.length ? Math.min(...gaps) : NaN;
    const [touch] = contactRows(future);
    const end = future.tick.at(-1);
    const at = touch !== undefined ? future.tick[touch] : end < HORIZON_TICK ? end : null;
    const touched = made("td", joined([touch === undefined && "none", at !== null && secondsText(at).replace(" ", "\u00a0")], " to "), {
      class: touch === undefined ? "number" : "number touches",
    });
    if (at !== null) touched.append(made("small", `tick ${future.branch + at}`));
    const value = (text, column) => {
      const cell = made("td", text, { class: "number" });
      if (isDoubted(player.group, [future], column)) cell.append(" ", made("small", "in doubt"));
      return cell;
    };
    row.append(
      name, value(Number.isFinite(least) ? least.toFixed(1) : "–", isTouched ? null : GAP),
      value(ahead.length ? numberText(future.speed[ahead.at(-1)], 1, "") : "–", SPEED),
      touched,
    );
    if (player.group.faults.length) row.append(made("td", numFaults(player.group, place) || "–", { class: "number" }));
    row.dataset.place = place;
    return row;
  }));
  markChosen();
}

function markChosen() {
  const wanted = player.mode === "two" ? [player.a, player.b] : [player.a];
  for (const row of byId("outcomes").children) row.classList.toggle("chosen", wanted.includes(Number(row.dataset.place)));
}

function choiceChanged() {
  const isTwo = player.mode === "two";
  byId("stage").classList.toggle("two", isTwo);
  byId("map-b").hidden = !isTwo;
  byId("pick-b").hidden = !isTwo;
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
  if (player.mode === "one") player.b = 0;
  if (player.mode === "one" || player.b !== spot.future) player.a = spot.future;
  setPlaying(false);
  if (spot.tick !== null) player.tick = withinTime(spot.tick);
  setAddress();
  fillChoices();
  choiceChanged();
  byId("stage").scrollIntoView({ block: "nearest" });
}

/** Go some places on in the list of what is wrong. */
function stepSpot(by) {
  const spots = player.group.spots;
  if (spots.length === 0) return;
  const at = spots.indexOf(player.spot);
  const isListed = byId("fault-list").contains(document.activeElement);
  chooseSpot(spots[at < 0 ? (by > 0 ? 0 : spots.length - 1) : (at + by + spots.length) % spots.length]);
  if (isListed) player.spot.button.focus({ preventScroll: true });
}

function markSpot() {
  const { spot, group } = player;
  for (const { button } of group.spots) button.setAttribute("aria-pressed", String(button === spot?.button));
  spot?.button.closest("details")?.setAttribute("open", "");
  const number = spot === null ? "" : `Place ${group.spots.indexOf(spot) + 1} of ${group.spots.length}`;
  byId("spot-text").textContent = spot === null ? "" : `${number}: ${spot.rule}, ${spotText(spot, group)}${spot.text ? `: ${spot.text}` : ""}`;
}

/** Give the group and the place that are shown an address, to which the browser leads back. */
function setAddress(isNew = false) {
  const { place, spot } = player;
  const hash = `#play-${place}${spot === null ? "" : `-${spot.rule}-${spot.number}`}`;
  if (location.hash !== hash) history[isNew ? "pushState" : "replaceState"](null, "", hash);
}

/** Close the player and go to a place of the report. */
function leaveTo(event, id) {
  event.preventDefault();
  player.leaveTo = id;
  dialog.close();
}

/** Open a group of the page, at a place of a finding where one is named; whether there is the group. */
function openGroup(place, rule, number) {
  const packed = documentOf(`group-data-${place}`);
  if (packed === null) return false;
  const group = packed.data === undefined ? { ...packed, futures: [] } : decodedGroup(packed, shared.steps);
  group.faults = decodedFaults(packed);
  group.spots = orderedSpots(group.faults);
  time.first = Math.min(HISTORY_TICK, ...group.futures.map((future) => future.tick[0]));
  group.remarkText = group.remarks.length ? `${group.remarks.length} remarks on what is not drawn` : "everything recorded is drawn";
  if (group.futures.length) group.frame = frameOf(group);
  Object.assign(player, { group, place, tick: 0, isPlaying: false, zoom: 1, pan: [0, 0], spot: null });
  byId("player-title").textContent = group.name;
  byId("player-facts").textContent = group.about;
  byId("player-remarks").replaceChildren(...group.remarks.map((text) => made("li", text)));
  byId("player-remarks").hidden = group.remarks.length === 0;
  byId("player-whole").hidden = group.futures.length === 0;
  byId("time").min = time.first;
  byId("play").textContent = "Play";
  byId("cameras").dataset.state = "none";
  byId("previous-group").disabled = place === 0;
  byId("next-group").disabled = document.getElementById(`group-data-${place + 1}`) === null;
  fillFaults(group, chooseSpot, leaveTo);
  const begins = !dialog.open;
  if (begins) dialog.showModal();
  setAddress(begins && player.opener !== null);
  // Space plays at once, and what is hidden takes no keys.
  if (begins || byId("player-whole").hidden) byId(group.futures.length ? "play" : "close-player").focus({ preventScroll: true });
  if (group.futures.length) {
    byId("spot-text").after(byId("faults"));
    fillChoices();
  } else byId("player-remarks").after(byId("faults"));
  const spot = group.faults.find((fault) => fault.rule === rule)?.spots[number];
  if (spot === undefined || spot.future < 0) choiceChanged();
  else chooseSpot(spot);
  return true;
}

/** Open what an address such as `#play-3` or `#play-3-BD-EVD-001-0` names; whether it names something. */
function openAddress(hash) {
  const asked = /^#play-(\d+)(?:-(BD-[A-Z]{3}-\d{3})-(\d+))?$/.exec(hash);
  return asked !== null && openGroup(Number(asked[1]), asked[2], Number(asked[3]));
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
