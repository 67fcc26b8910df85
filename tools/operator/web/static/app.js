// The page: one link to the console, panels around the scene, and everything held in one place.

import { Link } from "./link.js";
import { createPlots } from "./plots/plots.js";
import { createScene } from "./scene/scene.js";

const [description, catalogue] = await Promise.all(
  ["scene.json", "catalogue.json"].map((name) => fetch(name).then((answer) => answer.json())),
);
const link = new Link(localStorage.getItem("name") ?? "");
const scene = createScene(document.getElementById("scene"), description);
const plots = createPlots(document.getElementById("plots"), description);
link.addEventListener("state", ({ detail }) => {
  scene.update(detail);
  plots.update(detail);
});
document.title = `${catalogue.cell} · telerobot`;
