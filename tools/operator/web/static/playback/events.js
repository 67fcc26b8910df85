// All events of a run as sentences, oldest first; one that is pressed leads to its time.

import { el } from "../dom.js";

export function createEvents(element, events, seek) {
  const items = events.map((event) => ({
    t: event.t,
    item: el("li", { className: event.severity },
      el("button", { type: "button", onclick: () => seek(event.t) },
        el("p", {}, event.sentence),
        el("small", {}, `${event.t.toFixed(2)} s · ${event.name}`))),
  }));
  element.append(items.length
    ? el("ul", { className: "plain log events", "aria-label": "Events" }, ...items.map(({ item }) => item))
    : el("p", { className: "dim" }, "No events."));
  let last = null;
  return {
    update(time) {
      for (const { t, item } of items) item.classList.toggle("ahead", t > time + 1e-6);
      const now = items.filter(({ t }) => t <= time + 1e-6).at(-1)?.item ?? null;
      if (now !== last) now?.scrollIntoView({ block: "nearest" });
      last = now;
    },
  };
}
