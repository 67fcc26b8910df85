/** Meshes of robots: STL and OBJ, loaded once each, by the reader of their format. */

const loaded = new Map();

/** Return a promise of the geometries in a file. */
export function loadMesh(url) {
  if (!loaded.has(url)) loaded.set(url, load(url));
  return loaded.get(url);
}

async function load(url) {
  const suffix = url.split(".").at(-1);
  if (suffix === "stl") {
    const { STLLoader } = await import("../../vendor/STLLoader.js");
    const geometry = await new STLLoader().loadAsync(url);
    geometry.computeVertexNormals();
    return [geometry];
  }
  if (suffix === "obj") {
    const { OBJLoader } = await import("../../vendor/OBJLoader.js");
    const group = await new OBJLoader().loadAsync(url);
    const found = [];
    group.traverse((part) => part.geometry && found.push(part.geometry));
    return found;
  }
  throw new Error(`meshes of ${suffix} cannot be drawn`);
}
