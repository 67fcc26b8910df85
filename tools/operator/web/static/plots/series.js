/** Rows of numbers against time, taken from states: which charts a cell has, and what is in them. */

/** So much is shown [s]. */
export const WINDOW_S = 30;
/** States nearer in time than this are one row [s]. */
const STEP_S = 0.045;

const XYZ = [["x", "red"], ["y", "green"], ["z", "blue"]];
const COLOURS = ["teal", "orange", "violet", "green", "red", "blue", "amber", "grey"];
const number = (x, factor = 1) => (Number.isFinite(x) ? x * factor : null);
const size = (v) => (v && v.every((x) => Number.isFinite(x)) ? Math.hypot(...v) : null);
const least = (all) => (all.length ? Math.min(...all) : null);

/**
 * Return the charts of a described cell: title, unit, series and `row`, which takes their numbers
 * from a state, null where there is none.
 */
export function chartsOf(description) {
  const { tasks, joints, obstacles, sources, cameras } = description;
  const told = (state, i) => (i ? state.tasks?.[tasks[i].name] : state);
  const felt = tasks.flatMap((task, i) => (task.force ? [i] : []));
  const shared = tasks.flatMap((task, i) => (task.by.length > 1 ? [i] : []));
  const charts = [];
  const one = felt.length === 1 && tasks.length === 1;
  if (one) {
    for (const [title, unit, from] of [["Force", "N", 0], ["Moment", "N·m", 3]]) {
      charts.push({
        title, unit, least: from ? 0.5 : 5,
        series: XYZ.map(([name, colour]) => ({ name, colour })),
        row: (state) => [0, 1, 2].map((k) => number(state.wrench_mrf?.[from + k])),
      });
    }
  } else if (felt.length) {
    charts.push({
      title: "Force", unit: "N", least: 5, low: 0,
      series: [
        ...felt.map((i, k) => ({ name: tasks[i].name, colour: COLOURS[k % COLOURS.length] })),
        ...shared.map((i) => ({ name: `internal ${tasks[i].name}`, colour: "red" })),
      ],
      row: (state) => [
        ...felt.map((i) => size(told(state, i)?.wrench_mrf?.slice(0, 3))),
        ...shared.map((i) => number(told(state, i)?.internal_force)),
      ],
    });
  }
  // Tasks that a camera may lead: their own, and those of arms that carry together.
  const seeing = tasks.flatMap((task, i) => (
    cameras.some((camera) => camera.task === task.name) || (cameras.length && task.by.length > 1) ? [i] : []));
  if (seeing.length) charts.push({
    title: "Off the stored picture", unit: "px", least: 5, low: 0,
    series: seeing.map((i, k) => ({ name: tasks[i].name, colour: COLOURS[k % COLOURS.length] })),
    row: (state) => seeing.map((i) => number(told(state, i)?.view_error_px)),
  });
  const bounded = joints.flatMap((joint, i) => (joint.lower === null ? [] : [{ ...joint, i }]));
  charts.push({
    title: "Joints in their range", unit: "%", range: [-105, 105], bound: 100, tells: "farthest",
    thin: bounded.length > 8,
    series: bounded.map(({ name }, k) => ({ name, colour: COLOURS[k % COLOURS.length] })),
    row: (state) => bounded.map(({ lower, upper, i }) => (
      Number.isFinite(state.q[i]) ? (200 * (state.q[i] - lower)) / (upper - lower) - 100 : null)),
  });
  const names = new Set(obstacles.map((each) => each.name));
  if (description.avoidance.told) charts.push({
    title: "Nearest gaps", unit: "mm", least: 50, low: 0,
    series: [{ name: "obstacle", colour: "orange" }, { name: "itself", colour: "violet" }],
    row: ({ gaps = [] }) => [true, false].map((outside) => number(least(
      gaps.filter(([, other]) => names.has(other) === outside).map(([, , gap]) => gap)), 1000)),
  });
  charts.push({
    title: "Twist by source", unit: "mm/s", least: 20, low: 0,
    series: sources.map((name, i) => ({ name, colour: COLOURS[i % COLOURS.length] })),
    row: (state) => sources.map((name) => number(size(state.sources?.[name]?.slice(0, 3)), 1000)),
  });
  charts.push({
    title: "Period", unit: "ms", least: 0, low: 0, high: 2000 * description.period_s,
    series: [{ name: "tick", colour: "teal" }, { name: "overruns", colour: "red" }],
    row: (state, before) => [
      before && state.tick > before.tick
        ? number((state.time_s - before.time_s) / (state.tick - before.tick), 1000) : null,
      before ? number(state.overruns - before.overruns) : null,
    ],
  });
  return charts;
}

/** Return a memory of the last rows of all charts, one time for all of them. */
export function createSeries(charts) {
  const times = [];
  const columns = charts.map((chart) => chart.series.map(() => []));
  let before = null;
  return {
    /** Take in a state; return whether it made a row. */
    add(state) {
      const time = state.time_s;
      const last = times.at(-1);
      if (last !== undefined && time < last) {
        times.length = 0;
        for (const column of columns.flat()) column.length = 0;
        before = null;
      } else if (last !== undefined && time - last < STEP_S) {
        return false;
      }
      times.push(time);
      charts.forEach((chart, i) => {
        chart.row(state, before).forEach((x, k) => columns[i][k].push(x));
      });
      before = state;
      const old = times.findIndex((t) => t >= time - WINDOW_S);
      if (old > 60) {  // in portions: moving all rows for each new one is dear
        times.splice(0, old);
        for (const column of columns.flat()) column.splice(0, old);
      }
      return true;
    },
    times,
    data: (i) => [times, ...columns[i]],
  };
}
