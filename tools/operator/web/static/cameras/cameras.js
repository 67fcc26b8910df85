/**
 * The cameras: small pictures in a corner of the scene, and large in its place those that are
 * steered by, as video, each with how old what it shows is.
 */

import { button, el, setText } from "../dom.js";
import { canDecode, createScreen } from "./screen.js";

/** A camera that shows nothing new for so long has stopped [ms]. */
const STOPPED_MS = 1000;
/** Small pictures stand in for a video that has shown nothing for so long [ms]. */
const INSTEAD_MS = 800;
const TOLD_MS = 250;
const MEDIAN_OF = 15;

const OF_DELAY = "From the picture's exposure to its being drawn. One clock: the daemon's ticks, which the camera's process"
  + " and the console hear, and the console's clock, which the page reads by an echo. While you have the lease, half the"
  + " round trip to the daemon is added; without it, the way from the daemon to the console is not in it.";

/** Return what a camera's `times` of drawing and `ages` [ms] say; `now` is the page's clock [ms]. */
export function wordsOf({ times, ages, instead }, now) {
  const since = times.length ? now - times.at(-1) : Infinity;
  if (since > STOPPED_MS) {
    const words = times.length ? `no picture for ${Math.round(since / 1000)} s` : "no picture yet";
    return { words, state: "stopped" };
  }
  const span = times.at(-1) - times[0];
  const rate = times.length > 1 && span > 0 ? `${Math.round((1000 * (times.length - 1)) / span)} Hz` : "";
  const sorted = ages.filter((age) => age !== null).sort((a, b) => a - b);
  const age = sorted.length ? `${Math.round(sorted[sorted.length >> 1])} ms old` : "";
  return { words: [rate, age, instead].filter(Boolean).join(" · "), state: instead ? "instead" : "" };
}

/** `link` is the live page's; null where a recorded run is shown. */
export function createCameras(element, description, link) {
  const large = element.appendChild(el("div", { className: "cameras-large", hidden: true }));
  const small = element.appendChild(el("div", { className: "cameras" }));
  const views = new Map();
  let decodes = false;
  let ticking = null;
  canDecode.then((can) => {
    decodes = can;
    watch();
  });

  function add(name) {
    const camera = description.cameras.find((each) => each.name === name);
    const canvas = el("canvas");
    [canvas.width, canvas.height] = camera?.size ?? [640, 480];
    const words = el("span", {}, name);
    const thumb = button("", () => (view.tile ? shrink(view) : grow(view)), {
      "aria-label": `camera ${name} large`, "aria-pressed": "false",
    });
    thumb.append(canvas, words);
    small.append(thumb);
    const view = { name, canvas, words, thumb, busy: false, tile: null, at: performance.now() };
    views.set(name, view);
    return view;
  }

  function grow(view) {
    const canvas = el("canvas");
    [canvas.width, canvas.height] = [view.canvas.width, view.canvas.height];
    const words = el("output", { title: link ? OF_DELAY : "", "aria-live": "off" });
    const tile = button("", () => shrink(view), { className: "camera-tile", "aria-label": `camera ${view.name}: back to small` });
    tile.append(canvas, el("span", { className: "camera-words" }, el("b", {}, view.name), words));
    large.append(tile);
    Object.assign(view, { tile, large: canvas, told: words, times: [], ages: [], number: 0, filmed: -Infinity });
    view.screen = createScreen(canvas, {
      shown: (tick) => {
        view.filmed = performance.now();
        note(view, tick, "");
      },
      broken: () => {
        view.broken = true;
        watch();
      },
    });
    canvas.getContext("2d", { alpha: false }).drawImage(view.canvas, 0, 0);
    arrange();
  }

  function shrink(view) {
    const focused = view.tile.contains(document.activeElement);
    view.screen.end();
    view.tile.remove();
    Object.assign(view, { tile: null, screen: null, broken: false });
    arrange();
    if (focused) view.thumb.focus();
  }

  const grown = () => [...views.values()].filter((view) => view.tile);

  function arrange() {
    const open = grown();
    large.hidden = open.length === 0;
    large.dataset.count = String(open.length);
    for (const view of views.values()) view.thumb.setAttribute("aria-pressed", String(Boolean(view.tile)));
    element.closest("main")?.classList.toggle("looking", open.length > 0);
    element.dispatchEvent(new CustomEvent("cameras", { detail: open.length > 0 }));
    clearInterval(ticking);
    ticking = open.length && link ? setInterval(tell, TOLD_MS) : null;
    tell();
    watch();
  }

  /** Look at the videos of those that are large: what is asked for goes out with every beat. */
  function watch() {
    const seen = {};
    if (decodes && !document.hidden) {
      for (const view of grown()) if (!view.broken) seen[view.name] = view.number;
    }
    link?.watch(seen);
  }

  function note(view, tick, instead) {
    view.times.push(performance.now());
    view.ages.push(link?.ageOf(tick) ?? null);
    view.instead = instead;
    if (view.times.length > MEDIAN_OF) {
      view.times.shift();
      view.ages.shift();
    }
  }

  function tell() {
    for (const view of grown()) {
      if (!link) continue;
      const { words, state } = wordsOf(view, performance.now());
      setText(view.told, words);
      view.tile.dataset.state = state;
    }
    for (const view of views.values()) {
      if (link) view.thumb.classList.toggle("stopped", performance.now() - view.at > 2 * STOPPED_MS);
    }
  }
  if (link) setInterval(tell, 4 * TOLD_MS);

  addEventListener("keydown", (event) => {
    if (event.key === "Escape") for (const view of grown()) shrink(view);
  });
  document.addEventListener("visibilitychange", watch);
  link?.addEventListener("video", ({ detail }) => {
    const view = views.get(detail.camera);
    if (!view?.tile) return;
    view.number = detail.number;
    watch();
    view.screen.push(detail);
  });

  return {
    /** Draw a small picture, `{camera, tick, jpeg}`; one that comes while another is decoded is dropped. */
    async show({ camera, tick, jpeg }) {
      const view = views.get(camera) ?? add(camera);
      if (view.busy) return;
      view.busy = true;
      try {
        const bitmap = await createImageBitmap(blobOf(jpeg));
        view.at = performance.now();
        draw(view.canvas, bitmap);
        if (view.tile && view.at - view.filmed > INSTEAD_MS) {
          draw(view.large, bitmap);
          note(view, tick, decodes && !view.broken ? "small pictures: no video comes" : "small pictures: this browser decodes no H.264");
        }
        bitmap.close();
      } finally {
        view.busy = false;
      }
    },
  };
}

function draw(canvas, bitmap) {
  [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
}

/** Return a JPEG that was told in base 64. */
function blobOf(text) {
  return new Blob([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], { type: "image/jpeg" });
}
