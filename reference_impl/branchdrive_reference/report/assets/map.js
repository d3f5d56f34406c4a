// The map of a group: roads, actors, paths and egos at one time, in metres around the ego at the branch.

const KINDS = ["lane", "shoulder", "parking", "road_area", "crossing", "lane_border", "kerb", "wall", "stop_line", "signal",
  "stop_sign", "yield_sign"];
const ACTOR_INKS = ["vehicle", "cycle", "pedestrian", "static", "other"];
const ACTOR_NAMES = ["vehicle", "cycle", "pedestrian", "static object", "actor of another class"];

/** Roads of a town as paths of a canvas, by what they are drawn with. */
function roadPaths(elements) {
  const paths = new Map();
  const add = (layer, width, element, closed) => {
    const name = `${layer} ${width}`;
    if (!paths.has(name)) paths.set(name, { layer, width, path: new Path2D() });
    const { path } = paths.get(name);
    element.x.forEach((x, i) => (i ? path.lineTo(x, element.y[i]) : path.moveTo(x, element.y[i])));
    if (closed) path.closePath();
  };
  for (const element of elements) {
    const kind = KINDS[element.kind];
    if (kind === "road_area" || kind === "crossing") add(kind, 0, element, true);
    else if (kind === "lane" || kind === "shoulder" || kind === "parking") add(kind, element.width || 3, element, false);
    else if (kind === "lane_border") add(["edge", "solid", "broken"][element.marking], 0.15, element, false);
    else if (kind === "stop_line") add("stop_line", 0.4, element, false);
    else if (kind === "kerb" || kind === "wall") add(kind, 0.25, element, false);
  }
  const posts = elements.filter((element) => KINDS[element.kind].match(/sign/));
  return { layers: [...paths.values()], posts };
}

/** Where a series is at a time between its rows; null before the first row, after the last, and where rows lack. */
function poseAt(track, tick, most = 20) {
  const last = track.tick.length - 1;
  if (last < 0 || tick < track.tick[0] || tick > track.tick[last]) return null;
  let row = 0;
  while (row < last && track.tick[row + 1] <= tick) row += 1;
  if (row === last || track.tick[row] === tick) return [track.x[row], track.y[row], track.yaw[row]];
  if (track.tick[row + 1] - track.tick[row] > most) return null;
  const share = (tick - track.tick[row]) / (track.tick[row + 1] - track.tick[row]);
  return ["x", "y", "yaw"].map((name) => track[name][row] + share * (track[name][row + 1] - track[name][row]));
}

const STRIDE_TICKS = 5;
const APART_M = 0.4;
const actorAt = (track, tick) => poseAt(track, tick, STRIDE_TICKS);

/** Rows after the branch at which a touch begins. */
function contactRows(future) {
  return future.tick.map((tick, row) => row).filter((row) => future.tick[row] > 0 && future.touched[row] && !future.touched[row - 1]);
}

class MapView {
  constructor(figure) {
    this.figure = figure;
    this.canvas = figure.querySelector("canvas");
    this.pen = this.canvas.getContext("2d");
  }

  /** Draw a scene.
   * @param group what `decodedGroup` gives
   * @param roads what `roadPaths` gives, or null
   * @param look tick, chosen futures, the one of them that stands out, shown futures, zoom, pan, follow, ink of a
   *   future, places of findings and the chosen one of them
   */
  draw(group, roads, look) {
    const { pen, canvas } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const width = canvas.clientWidth;
    const height = Math.round(Math.min(Math.max(width * (width < 500 ? 0.9 : 0.6), 240), innerHeight * 0.62));
    if (width === 0) return;
    canvas.style.height = `${height}px`;
    if (canvas.width !== width * ratio || canvas.height !== height * ratio) {
      canvas.width = width * ratio;
      canvas.height = height * ratio;
    }
    const frame = look.frame;
    const scale = Math.min(width / frame.width, height / frame.height) * look.zoom;
    const turn = -group.heading;
    const middle = middleOf(look, turn, width / scale, height / scale);
    this.scale = scale;
    this.turn = group.heading;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = ink("ground");
    pen.fillRect(0, 0, width, height);
    pen.translate(width / 2 + look.pan[0], height / 2 + look.pan[1]);
    pen.scale(scale, -scale);
    pen.translate(-middle[0], -middle[1]);
    pen.rotate(turn);
    pen.lineJoin = "round";
    if (roads) this.roads(roads, group.at);
    this.route(group.route);
    this.actors(group, look);
    for (const future of look.shown) {
      if (!look.chosen.includes(future)) this.path(future, look, 0.9 / scale, 0.55);
    }
    const isAll = look.mode === "all";
    for (const future of look.chosen) this.path(future, look, (isAll && future !== look.lead ? 1.8 : 2.6) / scale, 1);
    for (const future of [...look.shown, ...look.chosen, look.lead]) {
      const isMain = isAll || look.chosen.includes(future);
      if (isMain) this.ego(future, group.box, look, future === look.lead);
      this.contacts(future, look, isMain);
    }
    this.faults(group, look);
    this.scaleBar(ratio, height, scale);
  }

  roads({ layers, posts }, [x, y]) {
    const { pen, scale } = this;
    pen.save();
    pen.translate(-x, -y);
    pen.lineCap = "butt";
    const each = (...wanted) => layers.filter(({ layer }) => wanted.includes(layer));
    const stroke = (name, part, extra = 0) => {
      pen.strokeStyle = ink(name);
      pen.lineWidth = part.width + extra;
      pen.stroke(part.path);
    };
    const fill = (name, part) => {
      pen.fillStyle = ink(name);
      pen.fill(part.path);
    };
    for (const part of each("lane", "shoulder", "parking")) stroke("kerb", part, 3 / scale);
    for (const part of each("road_area")) {
      fill("paved", part);
    }
    for (const part of each("shoulder")) stroke("paved", part);
    for (const part of each("parking")) stroke("parking", part);
    for (const part of each("lane")) stroke("carriageway", part);
    for (const part of each("road_area")) fill("carriageway", part);
    pen.globalAlpha = 0.5;
    for (const part of each("crossing")) fill("marking", part);
    pen.globalAlpha = 1;
    for (const part of each("edge")) stroke("paved", part);
    for (const part of each("solid")) stroke("marking", part);
    pen.setLineDash([2, 3]);
    for (const part of each("broken")) stroke("marking", part);
    pen.setLineDash([]);
    for (const part of each("stop_line")) stroke("marking", part);
    for (const part of each("kerb")) stroke("kerb", part);
    for (const part of each("wall")) stroke("ink", part);
    for (const post of posts) {
      pen.fillStyle = { signal: ink("other"), stop_sign: ink("contact"), yield_sign: ink("marking") }[KINDS[post.kind]];
      pen.strokeStyle = ink("ink");
      pen.lineWidth = 1 / scale;
      pen.beginPath();
      pen.arc(post.x[0], post.y[0], Math.max(0.55, 3.2 / scale), 0, 7);
      pen.fill();
      pen.stroke();
    }
    pen.restore();
  }

  route({ x, y }) {
    const { pen, scale } = this;
    pen.strokeStyle = ink("route");
    pen.lineWidth = 1.4 / scale;
    pen.setLineDash([7 / scale, 6 / scale]);
    this.line(x, y);
    pen.setLineDash([]);
  }

  line(x, y) {
    const { pen } = this;
    pen.beginPath();
    x.forEach((value, i) => (i ? pen.lineTo(value, y[i]) : pen.moveTo(value, y[i])));
    pen.stroke();
  }

  box([x, y, yaw], length, width, fill, edge, lineWidth, alpha = 1) {
    const { pen } = this;
    pen.save();
    pen.translate(x, y);
    pen.rotate(yaw);
    pen.globalAlpha = alpha;
    if (fill) {
      pen.fillStyle = fill;
      pen.fillRect(-length / 2, -width / 2, length, width);
    }
    pen.globalAlpha = 1;
    pen.strokeStyle = edge;
    pen.lineWidth = lineWidth;
    pen.strokeRect(-length / 2, -width / 2, length, width);
    pen.beginPath();
    pen.moveTo(length / 2 - width * 0.45, width / 2);
    pen.lineTo(length / 2, 0);
    pen.lineTo(length / 2 - width * 0.45, -width / 2);
    pen.stroke();
    pen.restore();
  }

  /** Actors of the chosen future; of all, those of the first, and those of others where they part. */
  actors(group, look) {
    const first = look.mode === "all" ? look.shown[0] ?? group.futures[0] : look.chosen[0];
    if (first === undefined) return;
    const { scale } = this;
    for (const [id, track] of first.tracks) {
      const pose = actorAt(track, look.tick);
      if (pose) this.box(pose, track.length, track.width, ink(ACTOR_INKS[track.kind] ?? "other"), ink("ink"), 0.9 / scale);
      if (look.mode !== "all") continue;
      for (const other of look.shown) {
        const apart = other === first ? null : other.tracks.get(id);
        const its = apart && actorAt(apart, look.tick);
        if (its && (!pose || Math.hypot(its[0] - pose[0], its[1] - pose[1]) > APART_M)) {
          this.box(its, apart.length, apart.width, null, look.ink(other), 1.6 / scale);
        }
      }
    }
    if (look.mode !== "all") {
      if (look.tick <= 0 && look.spots.length) this.nominalActors(first, look);
      return;
    }
    for (const other of look.shown) {
      for (const [id, track] of other.tracks) {
        const pose = first.tracks.has(id) ? null : actorAt(track, look.tick);
        if (pose) this.box(pose, track.length, track.width, null, look.ink(other), 1.6 / scale);
      }
    }
  }

  /** Before the branch, actors that the nominal has and a future with findings lacks or has elsewhere. */
  nominalActors(future, look) {
    const { pen, scale } = this;
    pen.setLineDash([4 / scale, 3 / scale]);
    for (const [id, track] of look.nominal.tracks) {
      const own = future.tracks.get(id);
      const [pose, its] = [actorAt(track, look.tick), own && actorAt(own, look.tick)];
      if (pose && !(its && Math.hypot(its[0] - pose[0], its[1] - pose[1]) < APART_M)) {
        this.box(pose, track.length, track.width, null, ink("fault"), 1.6 / scale);
      }
    }
    pen.setLineDash([]);
  }

  path(future, look, lineWidth, alpha) {
    const { pen, scale } = this;
    const start = future === look.nominal ? -Infinity : 0;
    const rows = future.tick.map((tick, row) => row).filter((row) => future.tick[row] >= start);
    const [x, y] = [rows.map((row) => future.x[row]), rows.map((row) => future.y[row])];
    pen.globalAlpha = alpha;
    if (alpha === 1) {
      pen.strokeStyle = ink("paper");
      pen.lineWidth = lineWidth + 2.4 / scale;
      this.line(x, y);
    }
    pen.strokeStyle = look.ink(future);
    pen.lineWidth = lineWidth;
    this.line(x, y);
    pen.globalAlpha = 1;
  }

  ego(future, [length, width], look, isFilled) {
    const tick = Math.min(look.tick, future.tick.at(-1));
    const pose = poseAt(future, tick);
    if (pose === null || (look.tick < 0 && future !== look.lead && look.mode === "all")) return;
    const isOver = look.tick > future.tick.at(-1);
    this.box(pose, length, width, look.ink(future), isFilled ? ink("paper") : look.ink(future), 1.4 / this.scale, isOver ? 0.15 : isFilled ? 1 : 0.4);
  }

  contacts(future, look, isMain) {
    const { pen, scale } = this;
    const size = (isMain ? 6 : 3.5) / scale;
    for (const row of contactRows(future)) {
      for (const [colour, lineWidth] of [[ink("paper"), isMain ? 5 : 3], [isMain ? ink("contact") : look.ink(future), isMain ? 2.4 : 1.4]]) {
        pen.strokeStyle = colour;
        pen.lineWidth = lineWidth / scale;
        this.line([future.x[row] - size, future.x[row] + size], [future.y[row] - size, future.y[row] + size]);
        this.line([future.x[row] - size, future.x[row] + size], [future.y[row] + size, future.y[row] - size]);
      }
    }
  }

  /** Places of findings: a diamond on the path at its time, a ring around the actor that one names. */
  faults(group, look) {
    const { pen, scale } = this;
    const twice = (draw, lineWidth) => {
      for (const [colour, extra] of [[ink("paper"), 2.6], [ink("fault"), 0]]) {
        pen.strokeStyle = colour;
        pen.lineWidth = (lineWidth + extra) / scale;
        draw();
        pen.stroke();
      }
    };
    const [length, width] = group.box;
    const named = new Map();
    const places = new Map();
    for (const spot of look.spots) {
      const future = group.futures[spot.future];
      const isChosen = spot === look.spot;
      const track = spot.actor === null ? undefined : future.tracks.get(spot.actor);
      if (track && (isChosen || !named.has(track))) named.set(track, { spot, isChosen });
      const place = `${spot.future} ${spot.tick}`;
      if (spot.tick !== null && (isChosen || !places.has(place))) places.set(place, { spot, future, isChosen });
    }
    for (const { spot, future, isChosen } of places.values()) {
      const pose = poseAt(future, spot.tick);
      if (pose === null) continue;
      const size = isChosen ? Math.hypot(length, width) / Math.SQRT2 + 4 / scale : 5.5 / scale;  // around the ego, not over it
      twice(() => {
        pen.beginPath();
        for (const [x, y] of [[size, 0], [0, size], [-size, 0], [0, -size]]) pen.lineTo(pose[0] + x, pose[1] + y);
        pen.closePath();
      }, isChosen ? 2.6 : 1.6);
    }
    for (const [track, { spot, isChosen }] of named) {
      const pose = actorAt(track, look.tick);
      if (pose === null) continue;
      const radius = Math.hypot(track.length, track.width) / 2 + 4 / scale;
      for (const more of [0, 5 / scale]) {
        twice(() => {
          pen.beginPath();
          pen.arc(pose[0], pose[1], radius + more, 0, 7);
        }, isChosen ? 2.2 : 1.2);
      }
      this.text(`actor ${spot.actor}`, pose, radius + 12 / scale);
    }
  }

  /** A short text over a place of the map. */
  text(text, [x, y], above) {
    const { pen, scale } = this;
    pen.save();
    pen.translate(x, y);
    pen.rotate(this.turn);
    pen.scale(1 / scale, -1 / scale);
    pen.font = "600 12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.lineWidth = 4;
    pen.strokeStyle = ink("paper");
    pen.fillStyle = ink("fault");
    pen.strokeText(text, 0, -above * scale);
    pen.fillText(text, 0, -above * scale);
    pen.restore();
  }

  scaleBar(ratio, height, scale) {
    const { pen } = this;
    const length = [1, 2, 5, 10, 20, 50, 100, 200, 500].find((metres) => metres * scale >= 50) ?? 1000;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = ink("paper");
    pen.globalAlpha = 0.8;
    pen.fillRect(8, height - 32, length * scale + 16, 25);
    pen.globalAlpha = 1;
    pen.fillStyle = ink("ink");
    pen.fillRect(16, height - 14, length * scale, 3);
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(`${length} m`, 16, height - 18);
  }
}

/** What stands in the middle of the map, in the frame of `frameOf`: it moves where the ego would leave the map. */
function middleOf({ frame, follow, lead, tick }, turn, width, height) {
  const ego = poseAt(lead, Math.min(tick, lead.tick.at(-1)));
  if (ego === null) return [frame.u, frame.v];
  const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
  const [u, v] = [cos * ego[0] - sin * ego[1], sin * ego[0] + cos * ego[1]];
  if (follow) return [u, v];
  const kept = (middle, at, room) => Math.max(at - room, Math.min(at + room, middle));
  return [kept(frame.u, u, 0.42 * width), kept(frame.v, v, 0.42 * height)];
}

/** The rectangle that holds the futures, in the frame in which the ego drives to the right at the branch. */
function frameOf(group) {
  const [cos, sin] = [Math.cos(-group.heading), Math.sin(-group.heading)];
  let [left, right, low, high] = [-15, 15, -8, 8];
  for (const future of group.futures) {
    future.tick.forEach((tick, row) => {
      if (tick < -40 || tick > 90) return;
      const [u, v] = [cos * future.x[row] - sin * future.y[row], sin * future.x[row] + cos * future.y[row]];
      [left, right, low, high] = [Math.min(left, u), Math.max(right, u), Math.min(low, v), Math.max(high, v)];
    });
  }
  return { u: (left + right) / 2, v: (low + high) / 2, width: right - left + 16, height: high - low + 14 };
}
