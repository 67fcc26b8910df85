/** Meshes of robots: binary glTF as the console sends it, loaded once each. */

const loaded = new Map();
/** Edges that bend more than this are sharp [rad]. */
const CREASE = 0.6;

/** Return a promise of the parts of a file: geometry and its own colour, null for none. */
export function loadMesh(url) {
  if (!loaded.has(url)) loaded.set(url, load(url));
  return loaded.get(url);
}

async function load(url) {
  const [{ GLTFLoader }, { toCreasedNormals }] = await Promise.all([
    import("../../vendor/GLTFLoader.js"), import("../../vendor/BufferGeometryUtils.js"),
  ]);
  const { scene } = await new GLTFLoader().loadAsync(url);
  const parts = [];
  scene.traverse(({ isMesh, geometry, material }) => {
    if (!isMesh) return;
    const { r, g, b } = material.color;
    const colour = material.name === "own" ? [r, g, b, material.opacity] : null;
    parts.push({ geometry: toCreasedNormals(geometry.deleteAttribute("normal"), CREASE), colour });
  });
  return parts;
}
