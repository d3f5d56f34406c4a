// What is wrong in the group that is open: rules that it fails, their places, and marks of these on time and map.

/** Faults of a group of the page, their spots written out. */
function decodedFaults(group) {
  return group.faults.map((fault) => {
    const [title, level] = shared.rules[fault.rule];
    const spots = fault.spots.map(([future, tick, actor, attempt, count, text, column], number) => ({
      rule: fault.rule, number, future, tick, actor, attempt, count, text: fault.texts[text] ?? "", column: fault.columns[column],
    }));
    return { ...fault, title, level, spots };
  });
}

/** Places that can be gone to, by time and attempt; those of a whole attempt come last. */
function orderedSpots(faults) {
  const order = (spot) => spot.tick ?? Infinity;
  return faults.flatMap((fault) => fault.spots).filter((spot) => spot.future >= 0)
    .sort((a, b) => (order(a) === order(b) ? a.future - b.future : order(a) - order(b)));
}

const isInTime = (tick) => tick >= time.first && tick <= HORIZON_TICK;
const withinTime = (tick) => Math.max(time.first, Math.min(HORIZON_TICK, tick));
const secondsText = (tick) => `${tick < 0 ? "−" : "+"}${Math.abs(tick / 20).toFixed(2)} s`;

/** A time since the branch, after the tick of the attempt. */
const momentText = (tick, future) => joined([future && `tick ${Math.floor(future.branch + tick)}`, secondsText(tick)]);

/** Whom a spot is about, in words, with what of it is not drawn. */
function whoText(spot, group) {
  const future = group.futures[spot.future];
  if (future) return nameOf(future);
  return spot.attempt.includes(", attempt") ? `${spot.attempt} (not drawn)` : spot.attempt;
}

function actorText(spot, group) {
  const future = group.futures[spot.future];
  if (spot.actor === null) return "";
  return `actor ${spot.actor}${!future || future.tracks.has(spot.actor) ? "" : " (not drawn)"}`;
}

function timeOfSpot(spot, group) {
  if (spot.tick === null) return "";
  const aside = isInTime(spot.tick) ? "" : spot.tick < 0 ? ", before what is shown" : ", after what is shown";
  return `at ${momentText(spot.tick, group.futures[Math.max(spot.future, 0)])}${aside}`;
}

const joined = (words, sign = ", ") => words.filter(Boolean).join(sign);
const countText = (spot) => (spot.count > 1 ? `first of ${spot.count.toLocaleString("en")} places` : "");

/** Where a spot is, in words. */
function spotText(spot, group) {
  return joined([whoText(spot, group), actorText(spot, group), joined([countText(spot), timeOfSpot(spot, group)], " ")]);
}

/** Spots of some futures, those that can be gone to. */
function spotsOf(group, futures) {
  return group.spots.filter((spot) => futures.includes(group.futures[spot.future]));
}

/** Whether a finding on some futures is about a column, such as "speed_mps of observations". */
function isDoubted(group, futures, column) {
  return spotsOf(group, futures).some((spot) => spot.column === column);
}

/** How many rules a candidate fails, as far as it is known. */
function numFaults(group, place) {
  return group.faults.filter((fault) => fault.futures.includes(place)).length;
}

const SPOTS_LISTED = 6;

/** Spots of which the same is said, as buttons for those that can be gone to. */
function spotLists(text, spots, group, choose) {
  const where = new Set(spots.map((spot) => joined([actorText(spot, group), timeOfSpot(spot, group)], " ")));
  const isShared = spots.length > 1 && where.size === 1 && !where.has("");
  const items = spots.map((spot) => {
    const words = isShared ? joined([whoText(spot, group), countText(spot)]) : spotText(spot, group);
    const item = made("li");
    if (spot.future < 0) {
      item.textContent = words;
      item.className = "text";
    } else {
      spot.button = made("button", words, { type: "button", "aria-pressed": "false" });
      spot.button.addEventListener("click", () => choose(spot));
      item.append(spot.button);
    }
    return item;
  });
  const list = (some) => {
    const element = made("ul", "", { class: "spots" });
    element.append(...some);
    return element;
  };
  const parts = [made("p", joined([text || "with other values", isShared && `first ${[...where][0]}`], "; ")), list(items.slice(0, SPOTS_LISTED))];
  const further = items.slice(SPOTS_LISTED);
  if (further.length) {
    const details = made("details");
    details.append(made("summary", `${further.length} more ${further.length > 1 ? "attempts" : "attempt"}`), list(further));
    parts.push(details);
  }
  return parts;
}

/** A rule with its places; `leave` goes to a place of the report. */
function faultItem(fault, group, choose, leave) {
  const item = made("li", "", { class: `tone-${fault.level}` });
  const link = (text, id) => {
    const element = made("a", text, { href: `${shared.report}#${id}` });
    if (shared.report === "") element.addEventListener("click", (event) => leave(event, id));
    return element;
  };
  const head = made("p");
  head.append(made("strong", fault.title), " ", link(fault.rule, fault.rule), " · ", link("about this rule", `page-${fault.rule}`));
  item.append(head);
  const said = joined([fault.extent, fault.causes.length && `may follow from ${fault.causes.join(", ")}: look there first`], "; ");
  if (said) item.append(made("p", `${said}.`, { class: "quiet" }));
  for (const text of [...fault.texts, ""]) {
    const spots = fault.spots.filter((spot) => spot.text === text);
    if (spots.length) item.append(...spotLists(text, spots, group, choose));
  }
  const located = new Set(fault.spots.map((spot) => spot.future));
  const others = fault.futures.filter((place) => !located.has(place)).map((place) => nameOf(group.futures[place]));
  if (others.length) item.append(made("p", `Fail it too, at places that are not kept: ${others.join(", ")}.`, { class: "quiet" }));
  if (fault.spots.length === 0) item.append(made("p", "Where it fails in this group is not kept.", { class: "quiet" }));
  return item;
}

/** The list of what is wrong in a group. */
function fillFaults(group, choose, leave) {
  const num = group.faults.length;
  byId("faults").hidden = num === 0 && !group.judged;
  byId("faults-title").textContent = num ? `Findings: this group or attempts of it fail ${num} ${num > 1 ? "rules" : "rule"}` : "No rule finds anything in this group.";
  byId("fault-list").replaceChildren(...group.faults.map((fault) => faultItem(fault, group, choose, leave)));
  byId("fault-list").hidden = num === 0;
  byId("fault-steps").hidden = group.spots.length === 0;
}

/** Marks over the time; those of a place before or after what is shown stand at its ends. */
function drawTimeMarks(spots, chosen, choose) {
  const ticks = new Map();
  for (const spot of spots) {
    if (spot.tick === null) continue;
    const tick = withinTime(spot.tick);
    if (!ticks.has(tick) || spot === chosen) ticks.set(tick, spot);
  }
  byId("time-marks").replaceChildren(...[...ticks].map(([tick, spot]) => {
    const sign = spot.tick < tick ? "◀" : spot.tick > tick ? "▶" : spot === chosen ? "▼" : "▽";
    const mark = made("span", sign, { title: `${spot.rule}: ${spotText(spot, player.group)}` });
    const share = (tick - time.first) / (HORIZON_TICK - time.first);
    mark.style.left = `calc(0.5rem + ${share} * (100% - 1rem))`;
    mark.classList.toggle("chosen", spot === chosen);
    mark.addEventListener("click", () => choose(spot));
    return mark;
  }));
}
