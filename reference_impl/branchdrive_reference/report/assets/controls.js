// What the player does at a click and at a key, and how it is opened and left.

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
  if (target === null) {
    if (location.hash.startsWith("#play-")) history.replaceState(null, "", location.href.split("#")[0]);
    opener?.focus();
  } else {
    history.pushState(null, "", `#${target.id}`);
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
byId("show-keys").addEventListener("click", () => {
  const isShown = byId("keys").hidden;
  byId("keys").hidden = !isShown;
  byId("show-keys").setAttribute("aria-expanded", String(isShown));
  if (isShown) byId("keys").scrollIntoView({ block: "nearest" });
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
  "?": () => byId("show-keys").click(),
};

/** Whether an element needs a key itself: lists all but numbers, boxes the space and radio buttons arrows too. */
function needsKey({ tagName, type }, key) {
  if (tagName === "SELECT") return !/^[123]$/.test(key);
  return (["checkbox", "radio"].includes(type) && key === " ") || (type === "radio" && key.startsWith("Arrow"));
}

let lastKey = null;
document.addEventListener("keydown", (event) => {
  lastKey = event.key;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (!dialog.open || event.ctrlKey || event.metaKey || event.altKey || !(key in keys) || needsKey(event.target, key)) return;
  if ((key === "ArrowUp" || key === "ArrowDown") && !event.shiftKey) return;
  event.preventDefault();
  keys[key](event);
});
document.addEventListener("keyup", (event) => {
  if (dialog.open && event.key === " " && !needsKey(event.target, " ")) event.preventDefault();
});
// What was chosen with a pointer, or from an open list, leaves the keys to the player.
dialog.addEventListener("pointerdown", () => { lastKey = null; });
dialog.addEventListener("focusin", ({ target }) => { if (target.tagName === "SELECT") lastKey = null; });
dialog.addEventListener("change", ({ target }) => {
  if (lastKey === null || (target.tagName === "SELECT" && [" ", "Enter"].includes(lastKey))) byId("play").focus({ preventScroll: true });
});
addEventListener("resize", redraw);
addEventListener("themechange", redraw);

// A page of one group opens it; in a report an address does.
if (!openAddress(location.hash) && document.body.dataset.opens !== undefined) openGroup(0);
addEventListener("hashchange", () => {
  if (!openAddress(location.hash)) dialog.close();
});
