// Lines over time with a common cursor: speed, gap and commands.

const HISTORY_TICK = -80;
const HORIZON_TICK = 130;

/** The first tick of the group that is open: earlier than the history where a finding is. */
const time = { first: HISTORY_TICK };
const LEFT = 38;
const RIGHT = 8;
const TOP = 8;
const BOTTOM = 22;

/** Dashes by family, so that colour is not all that tells lines apart. */
const DASHES = [[], [7, 3], [2, 2.5], [9, 3, 2, 3], [4, 2]];

class Chart {
  constructor(figure, onTime) {
    this.canvas = figure.querySelector("canvas");
    this.output = figure.querySelector("output");
    this.pen = this.canvas.getContext("2d");
    const point = (event) => {
      const place = event.clientX - this.canvas.getBoundingClientRect().left;
      const share = (place - LEFT) / (this.canvas.clientWidth - LEFT - RIGHT);
      onTime(Math.round(time.first + share * (HORIZON_TICK - time.first)));
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      point(event);
    });
    this.canvas.addEventListener("pointermove", (event) => event.buttons && point(event));
  }

  /** Draw lines.
   * @param lines each with tick, values, colour, width, dash and rows of contacts
   * @param range lowest and highest value, or null to fit
   * @param tick where the cursor is
   * @param marks ticks of findings, and whether each is chosen
   */
  draw(lines, range, tick, marks = []) {
    const { pen, canvas } = this;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth, 150];
    if (width === 0) return;
    canvas.style.height = `${height}px`;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = ink("paper");
    pen.fillRect(0, 0, width, height);
    const [low, high] = range ?? this.fitted(lines);
    const right = width - RIGHT;
    const x = (at) => LEFT + ((at - time.first) / (HORIZON_TICK - time.first)) * (right - LEFT);
    const y = (value) => height - BOTTOM - ((value - low) / (high - low)) * (height - BOTTOM - TOP);
    pen.fillStyle = ink("window");
    pen.fillRect(x(0), TOP, x(50) - x(0), height - BOTTOM - TOP);
    this.axes(low, high, x, y, right, height);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP - 2, right - LEFT, height - BOTTOM - TOP + 4);
    pen.clip();
    for (const line of lines) this.line(line, x, y);
    pen.restore();
    pen.strokeStyle = pen.fillStyle = ink("fault");
    pen.lineWidth = 1.4;
    for (const mark of marks) {
      pen.beginPath();
      pen.moveTo(x(mark.tick) - 4.5, TOP - 6);
      pen.lineTo(x(mark.tick) + 4.5, TOP - 6);
      pen.lineTo(x(mark.tick), TOP + 2);
      pen.closePath();
      pen.stroke();
      if (mark.isChosen) pen.fill();
    }
    pen.strokeStyle = ink("ink");
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(x(tick), TOP);
    pen.lineTo(x(tick), height - BOTTOM);
    pen.stroke();
  }

  fitted(lines) {
    let [low, high] = [0, 1];
    for (const { values } of lines) {
      for (const value of values) if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
    return [low, high + 0.06 * (high - low)];
  }

  axes(low, high, x, y, right, height) {
    const { pen } = this;
    pen.font = "11px system-ui, sans-serif";
    pen.strokeStyle = ink("line");
    pen.fillStyle = ink("quiet");
    pen.lineWidth = 1;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const step = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((one) => (high - low) / one <= 4.5) ?? (high - low) / 4;
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      pen.beginPath();
      pen.moveTo(LEFT, y(value));
      pen.lineTo(right, y(value));
      pen.stroke();
      pen.fillText(`${Math.round(value * 10) / 10}`, LEFT - 5, y(value));
    }
    pen.textAlign = "center";
    pen.textBaseline = "top";
    const stride = HORIZON_TICK - time.first > 300 ? 80 : 40;
    for (let tick = Math.ceil(time.first / stride) * stride; tick < HORIZON_TICK; tick += stride) {
      pen.fillText(`${tick > 0 ? "+" : ""}${tick / 20} s`, Math.max(x(tick), LEFT + 12), height - BOTTOM + 6);
    }
  }

  line({ tick, values, colour, width, dash, contacts = [], alpha = 1 }, x, y) {
    const { pen } = this;
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.globalAlpha = alpha;
    pen.setLineDash(dash);
    pen.beginPath();
    let isDown = false;
    values.forEach((value, row) => {
      if (!Number.isFinite(value)) isDown = false;
      else if (isDown) pen.lineTo(x(tick[row]), y(value));
      else {
        pen.moveTo(x(tick[row]), y(value));
        isDown = true;
      }
    });
    pen.stroke();
    pen.setLineDash([]);
    pen.strokeStyle = ink("contact");
    pen.lineWidth = 1.8;
    for (const row of contacts) {
      const [at, level] = [x(tick[row]), y(Number.isFinite(values[row]) ? values[row] : 0)];
      pen.beginPath();
      pen.moveTo(at - 3.5, level - 3.5);
      pen.lineTo(at + 3.5, level + 3.5);
      pen.moveTo(at - 3.5, level + 3.5);
      pen.lineTo(at + 3.5, level - 3.5);
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }
}

/** Speed by the way between observations, at the middle of each. */
function wayOf({ tick, x, y }) {
  const rows = tick.map((_, row) => row).slice(1);
  return {
    tick: rows.map((row) => (tick[row] + tick[row - 1]) / 2),
    values: rows.map((row) => Math.hypot(x[row] - x[row - 1], y[row] - y[row - 1]) / ((tick[row] - tick[row - 1]) / 20)),
  };
}

/** The value of a series at the last row up to a time; NaN before the first and a while after the last. */
function valueAt(ticks, values, tick) {
  let found = NaN;
  for (let row = 0; row < ticks.length && ticks[row] <= tick; row++) found = values[row];
  return tick > ticks.at(-1) + 5 ? NaN : found;
}
