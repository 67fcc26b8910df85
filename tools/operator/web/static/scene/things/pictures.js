/** Pictures of the cameras in a corner of the scene; pressed, one is drawn large. */

const SMALL = "min(180px, 17vw)";

export function createPictures(element, description) {
  const box = document.createElement("div");
  box.className = "scene-pictures";
  Object.assign(box.style, {
    position: "absolute", left: "12px", bottom: "12px", display: "flex", flexWrap: "wrap-reverse",
    gap: "8px", alignItems: "flex-end", maxWidth: "calc(100% - 390px)", pointerEvents: "none",
  });
  element.append(box);
  const shown = new Map();

  function add(name) {
    const camera = description.cameras.find((c) => c.name === name);
    const button = document.createElement("button");
    button.type = "button";
    button.setAttribute("aria-label", `camera ${name}: larger or smaller`);
    Object.assign(button.style, {
      padding: "0", border: "1px solid rgba(140, 150, 160, 0.5)", borderRadius: "8px",
      overflow: "hidden", lineHeight: "0", background: "#000", cursor: "pointer",
      pointerEvents: "auto", position: "relative", width: SMALL, boxShadow: "0 4px 18px rgba(0, 0, 0, 0.35)",
    });
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = camera?.size ?? [640, 480];
    Object.assign(canvas.style, { width: "100%", display: "block" });
    const words = document.createElement("span");
    words.textContent = name;
    Object.assign(words.style, {
      position: "absolute", left: "6px", top: "5px", padding: "1px 6px", borderRadius: "5px",
      font: "500 11px/15px ui-sans-serif, system-ui, sans-serif", color: "#fff",
      background: "rgba(18, 21, 26, 0.72)",
    });
    button.append(canvas, words);
    let large = false;
    button.addEventListener("click", () => {
      large = !large;
      button.style.width = large ? "min(46vw, 560px)" : SMALL;
      button.setAttribute("aria-pressed", String(large));
    });
    box.append(button);
    shown.set(name, { canvas, busy: false });
    return shown.get(name);
  }

  return {
    /** Draw a picture, a Blob that the browser can decode; one that comes while another is decoded is dropped. */
    async show(name, blob) {
      const view = shown.get(name) ?? add(name);
      if (view.busy) return;
      view.busy = true;
      try {
        const bitmap = await createImageBitmap(blob);
        [view.canvas.width, view.canvas.height] = [bitmap.width, bitmap.height];
        view.canvas.getContext("2d").drawImage(bitmap, 0, 0);
        bitmap.close();
      } finally {
        view.busy = false;
      }
    },
    dispose() { box.remove(); },
  };
}
