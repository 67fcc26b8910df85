/** The ground: a grid of metres and decimetres that fades into the distance, and shadows on it. */

import * as THREE from "../../vendor/three.module.js";

const RADIUS = 14;

const VERTEX = `
  varying vec3 place;
  void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    place = world.xyz;
    gl_Position = projectionMatrix * viewMatrix * world;
  }`;

const FRAGMENT = `
  uniform vec3 colour;
  uniform vec2 centre;
  uniform float strength, extent;
  varying vec3 place;
  float lines(vec2 p, float step, float width) {
    vec2 at = p / step;
    vec2 blur = fwidth(at);
    vec2 off = abs(fract(at - 0.5) - 0.5);
    vec2 line = 1.0 - smoothstep(width * blur, (width + 1.0) * blur, off);
    // Lines nearer than two pixels to each other are a grey that says nothing.
    line *= 1.0 - smoothstep(0.25, 0.6, blur);
    return max(line.x, line.y);
  }
  void main() {
    float far = length(place.xy - centre) / extent;
    float fade = pow(max(0.0, 1.0 - far), 1.7);
    float grid = max(0.38 * lines(place.xy, 0.1, 0.3), lines(place.xy, 0.5, 0.55));
    gl_FragColor = vec4(colour, strength * fade * grid);
    if (gl_FragColor.a < 0.002) discard;
  }`;

export function createGround() {
  const uniforms = {
    colour: { value: new THREE.Color() },
    centre: { value: new THREE.Vector2() },
    strength: { value: 0.3 },
    extent: { value: 4 },
  };
  const grid = new THREE.Mesh(
    new THREE.CircleGeometry(RADIUS, 64),
    new THREE.ShaderMaterial({
      uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT, transparent: true, depthWrite: false,
      side: THREE.DoubleSide,
    }),
  );
  const shade = new THREE.Mesh(
    new THREE.CircleGeometry(RADIUS, 64),
    new THREE.ShadowMaterial({ transparent: true, depthWrite: false }),
  );
  shade.receiveShadow = true;
  shade.position.z = -0.0005;
  const object = new THREE.Group();
  object.add(shade, grid);
  return {
    object,
    /** Lay the ground under a place; it fades within `extent` of it [m]. */
    lay(centre, height, extent) {
      object.position.set(centre.x, centre.y, height);
      uniforms.centre.value.set(centre.x, centre.y);
      uniforms.extent.value = extent;
    },
    setTheme(theme) {
      uniforms.colour.value.set(theme.grid);
      uniforms.strength.value = theme.gridStrength;
      shade.material.opacity = theme.shadow;
    },
  };
}
