/** One chart of the strip: uPlot below a heading that tells the numbers under the cursor. */

import uPlot from "../vendor/uPlot.esm.js";

const INK = {
  red: "#e5484d", green: "#46a758", blue: "#4c82f7", teal: "#22a2b6", orange: "#e08a3c",
  violet: "#8f7ae5", amber: "#d9a514", grey: "#8b98a5",
};
const DECIMALS = { N: 1, "N·m": 2, "%": 0, mm: 0, "mm/s": 0, ms: 2 };
const LINKED = "telerobot";
/** Times that are marked: so long ago [s]. */
const AGO_S = [25, 15, 5];

export function createChart(element, chart, { events, times }) {
  const box = document.createElement("figure");
  Object.assign(box.style, {
    margin: "0", flex: "1 0 150px", minWidth: "150px", display: "flex", flexDirection: "column",
    padding: "5px 6px 0 8px", borderRight: "1px solid rgba(128, 138, 150, 0.22)",
  });
  const heading = document.createElement("figcaption");
  Object.assign(heading.style, {
    display: "grid", gridTemplateRows: "16px 16px", whiteSpace: "nowrap",
    font: "600 11px/16px ui-sans-serif, system-ui, sans-serif",
  });
  const title = document.createElement("span");
  title.textContent = `${chart.title} `;
  const unit = document.createElement("span");
  unit.textContent = chart.unit;
  unit.style.fontWeight = "400";
  const named = document.createElement("div");
  named.append(title, unit);
  const numbers = document.createElement("div");
  Object.assign(numbers.style, { display: "flex", gap: "7px", minWidth: "0", overflow: "hidden" });
  heading.append(named, numbers);
  const values = chart.series.map(({ name, colour }) => {
    // Words in the page's own colour can be read on any ground; a mark has that of the line.
    const value = document.createElement("span");
    const mark = document.createElement("span");
    const words = document.createElement("span");
    Object.assign(mark.style, {
      display: "inline-block", width: "7px", height: "7px", borderRadius: "2px", marginRight: "3px",
      background: INK[colour],
    });
    Object.assign(value.style, { fontVariantNumeric: "tabular-nums", fontWeight: "500" });
    value.title = name;
    value.append(mark, words);
    numbers.append(value);
    return { value, words };
  });
  const canvas = document.createElement("div");
  Object.assign(canvas.style, { flex: "1", minHeight: "0", overflow: "hidden" });
  box.append(heading, canvas);
  element.append(box);

  const ink = () => getComputedStyle(box).color;
  const faint = () => "rgba(128, 138, 150, 0.2)";
  const axis = (more) => ({
    stroke: ink, font: "10px ui-sans-serif, system-ui, sans-serif",
    grid: { stroke: faint, width: 1 }, ticks: { show: false }, ...more,
  });
  const plot = new uPlot({
    width: 216, height: 120, padding: [5, 4, 0, 0],
    legend: { show: false },
    cursor: { sync: { key: LINKED, setSeries: false }, drag: { x: false, y: false }, points: { size: 5 } },
    scales: { x: { time: false }, y: { range: (_u, low, high) => rangeOf(chart, low, high) } },
    axes: [
      axis({
        size: 16, gap: 1,
        splits: (u) => AGO_S.map((ago) => u.scales.x.max - ago),
        values: () => AGO_S.map((ago) => `${-ago} s`),
      }),
      axis({ size: 32, gap: 2, space: 26 }),
    ],
    series: [{}, ...chart.series.map(({ colour }) => ({
      stroke: INK[colour], width: chart.thin ? 1 : 1.5, points: { show: false }, spanGaps: false,
    }))],
    hooks: {
      draw: [(u) => marks(u, chart, events)],
      setCursor: [() => tell()],
    },
  }, [[0], ...chart.series.map(() => [null])], canvas);
  const decimals = DECIMALS[chart.unit] ?? 1;
  let sized = "";

  /** Write the numbers under the cursor, else the newest. */
  function tell() {
    const row = plot.cursor.idx ?? plot.data[0].length - 1;
    const now = chart.series.map((_, k) => plot.data[k + 1][row]);
    const farthest = Math.max(...now.map((x) => Math.abs(x ?? 0)));
    chart.series.forEach(({ name }, k) => {
      const x = now[k];
      const told = Number.isFinite(x) && (chart.tells === "farthest"
        ? Math.abs(x) === farthest : chart.series.length < 5 || Math.abs(x) >= 0.5);
      values[k].value.hidden = !told;
      if (!told) return;
      // Adding zero takes the sign off a negative one.
      const words = `${name} ${(Number(x.toFixed(decimals)) + 0).toFixed(decimals)}`;
      if (values[k].words.textContent !== words) values[k].words.textContent = words;
    });
  }

  return {
    draw(data, from) {
      const [width, height] = [canvas.clientWidth, canvas.clientHeight];
      if (!width || !height) return;
      if (sized !== `${width} ${height}`) plot.setSize({ width, height });
      sized = `${width} ${height}`;
      plot.setData(data, false);
      plot.setScale("x", { min: from, max: times.at(-1) });
      tell();
    },
    dispose() {
      plot.destroy();
      box.remove();
    },
  };
}

function rangeOf(chart, low, high) {
  if (chart.range) return chart.range;
  const most = Math.max(chart.high ?? 0, high ?? 0, chart.least ?? 0);
  const least = chart.low ?? Math.min(low ?? 0, -(chart.least ?? 0));
  const room = 0.06 * (most - least || 1);
  return [chart.low ?? least - room, most + room];
}

/** Draw events as lines across the chart, and bounds. */
function marks(u, chart, events) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.lineWidth = devicePixelRatio;
  for (const { time, severity } of events) {
    const x = Math.round(u.valToPos(time, "x", true));
    ctx.strokeStyle = severity === "error" ? INK.red : INK.amber;
    ctx.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
  }
  if (chart.bound) {
    ctx.fillStyle = "rgba(229, 72, 77, 0.16)";
    for (const side of [-1, 1]) {
      const [a, b] = [0.93, 1.1].map((part) => u.valToPos(side * part * chart.bound, "y", true));
      ctx.fillRect(bbox.left, Math.min(a, b), bbox.width, Math.abs(b - a));
    }
  }
  ctx.restore();
}
