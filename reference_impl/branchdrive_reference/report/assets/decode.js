// Series of whole numbers, as `packing.py` packs them.

const MISSING = -(2 ** 30);

/** A document of the page. */
function documentOf(id) {
  const element = document.getElementById(id);
  return element === null ? null : JSON.parse(element.textContent);
}

class Unpacker {
  /** @param {string} text bytes in base 64 */
  constructor(text) {
    this.bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    this.at = 0;
  }

  token() {
    let value = 0;
    for (let weight = 1; ; weight *= 128) {
      const byte = this.bytes[this.at++];
      value += (byte & 0x7f) * weight;
      if (byte < 0x80) return value;
    }
  }

  /** The next `count` numbers, of which differences were taken `order` times. */
  whole(count, order = 1) {
    const values = new Array(count).fill(0);
    for (let place = 0; place < count; place++) {
      const token = this.token();
      if (token === 0) place += this.token();
      else values[place] = token % 2 ? -(token + 1) / 2 : token / 2;
    }
    for (let turn = 0; turn < order; turn++) {
      for (let place = 1; place < count; place++) values[place] += values[place - 1];
    }
    return values;
  }

  /** The next `count` numbers in a unit; NaN where one is missing. */
  numbers(count, step, order = 1) {
    return this.whole(count, order).map((value) => (value === MISSING ? NaN : value * step));
  }
}

/** A group with every series written out: places in metres from the ego at the branch, world directions. */
function decodedGroup(packed, steps) {
  const series = new Unpacker(packed.data);
  const places = (count) => [series.numbers(count, steps.place_m, 2), series.numbers(count, steps.place_m, 2)];
  const [routeX, routeY] = places(packed.route);
  const futures = [];
  for (const one of packed.futures) {
    futures.push({ branch: one.branch ?? packed.branch, ...decodedFuture(one, series, steps, places, futures[0]) });
  }
  return { ...packed, route: { x: routeX, y: routeY }, futures };
}

function decodedFuture(packed, series, steps, places, nominal) {
  const own = { key: packed.key, tick: series.whole(packed.rows, 2) };
  [own.x, own.y] = places(packed.rows);
  own.yaw = series.numbers(packed.rows, steps.yaw_rad, 2);
  own.speed = series.numbers(packed.rows, steps.speed_mps);
  own.gap = series.numbers(packed.rows, steps.gap_m);
  own.touched = series.whole(packed.rows);
  own.commandTick = series.whole(packed.commands, 2);
  own.commands = [0, 1, 2].map(() => series.numbers(packed.commands, steps.control));
  if (packed.shares) {
    const rows = nominal.tick.filter((tick) => tick <= 0).length;
    const commands = nominal.commandTick.filter((tick) => tick < 0).length;
    for (const name of ["tick", "x", "y", "yaw", "speed", "gap", "touched"]) {
      own[name] = nominal[name].slice(0, rows).concat(own[name]);
    }
    own.commandTick = nominal.commandTick.slice(0, commands).concat(own.commandTick);
    own.commands = own.commands.map((values, i) => nominal.commands[i].slice(0, commands).concat(values));
  }
  own.tracks = new Map();
  for (const [id, count, ...about] of packed.actors) {
    const before = nominal?.tracks.get(id);
    const began = packed.shares && before ? cutTrack(before, -Infinity, 0) : null;
    let track;
    if (count < 0) {
      track = cutTrack(before, about[0], about[1]);
    } else {
      const [kind, length, width] = about;
      track = { kind, length: length / 100, width: width / 100, tick: series.whole(count, 2) };
      [track.x, track.y] = places(count);
      track.yaw = series.numbers(count, steps.yaw_rad, 2);
    }
    own.tracks.set(id, began === null ? track : joinedTracks(began, track));
  }
  return own;
}

function cutTrack(track, first, last) {
  const kept = track.tick.map((tick, row) => (tick >= first && tick <= last ? row : -1)).filter((row) => row >= 0);
  const cut = (values) => kept.map((row) => values[row]);
  return { ...track, tick: cut(track.tick), x: cut(track.x), y: cut(track.y), yaw: cut(track.yaw) };
}

function joinedTracks(began, track) {
  const joined = { ...track };
  for (const name of ["tick", "x", "y", "yaw"]) joined[name] = began[name].concat(track[name]);
  return joined;
}

/** Elements of a town, places in metres of the world. */
function decodedTown(packed) {
  const series = new Unpacker(packed.data);
  const elements = [];
  for (let place = 0; place < packed.elements.length; place += 4) {
    const [kind, marking, width, count] = packed.elements.slice(place, place + 4);
    elements.push({
      kind, marking, width: width / 100,
      x: series.numbers(count, packed.step_m, 2), y: series.numbers(count, packed.step_m, 2),
    });
  }
  return elements;
}
