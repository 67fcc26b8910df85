// Events as sentences, newest first, with what to do next. All text goes in as text.

import { el } from "../dom.js";

const MOST = 120;

export function createLog(element) {
  const list = el("ul", { className: "plain log", "aria-label": "Events, newest first" });
  const none = el("p", { className: "dim" }, "Nothing yet.");
  element.append(none, list);
  let newest = null;
  return {
    add(event) {
      if (newest !== null && event.id === newest) return;
      newest = event.id;
      none.hidden = true;
      list.prepend(el("li", { className: event.severity },
        el("p", {}, event.sentence),
        event.next ? el("p", { className: "next" }, event.next) : null,
        el("small", {}, `${event.time_s.toFixed(2)} s · ${event.name}`)));
      if (list.childElementCount > MOST) list.lastElementChild.remove();
    },
  };
}
