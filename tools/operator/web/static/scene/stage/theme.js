/** Colours of the scene, dark and light: white shells and graphite joints on a quiet ground. */

const SHARED = {
  x: 0xe5484d,
  y: 0x46a758,
  z: 0x3e7bfa,
  danger: 0xe5484d,
  warning: 0xf0a020,
  beam: 0xc9a36a,
  metal: 0x9aa3ad,
};

export const THEMES = {
  dark: {
    ...SHARED,
    background: "radial-gradient(120% 100% at 50% 18%, #3a434f 0%, #232932 50%, #15191f 100%)",
    ink: "#e8ecf1",
    plate: "rgba(18, 21, 26, 0.72)",
    grid: 0x8fa3b8,
    gridStrength: 0.34,
    shadow: 0.5,
    shell: 0xe4e2dc,
    joint: 0x2b3037,
    accents: [0x27a3b5, 0xd9822b, 0x8f7ae5, 0x5ba760],
    ghost: 0x5fd4e6,
    target: 0xffb454,
    trail: 0x5fd4e6,
    furniture: 0x59616c,
    obstacle: 0xd08b5b,
    wall: 0x8c95a1,
    glass: 0x9fc4d8,
    gap: 0x9aa7b5,
    force: 0xffd166,
    sight: 0x9fe3a8,
    scan: 0xffe3a3,
    space: 0x7f93a8,
    exposure: 1.0,
    key: 2.9,
    fill: 0.45,
    surround: 0.34,
  },
  light: {
    ...SHARED,
    background: "radial-gradient(120% 100% at 50% 15%, #ffffff 0%, #eef0f2 55%, #dcdfe3 100%)",
    ink: "#1d232b",
    plate: "rgba(255, 255, 255, 0.82)",
    grid: 0x5b6b7c,
    gridStrength: 0.3,
    shadow: 0.26,
    shell: 0xfafaf7,
    joint: 0x3a4149,
    accents: [0x0f8a9d, 0xc46a12, 0x6d55cf, 0x3d8b45],
    ghost: 0x0e95ab,
    target: 0xd9730d,
    trail: 0x0e95ab,
    furniture: 0xb9bfc7,
    obstacle: 0xc9743c,
    wall: 0x9aa3ad,
    glass: 0x5d8ea8,
    gap: 0x66737f,
    force: 0xb86e00,
    sight: 0x2f9e44,
    scan: 0x9a6200,
    space: 0x62758a,
    exposure: 1.0,
    key: 2.6,
    fill: 0.9,
    surround: 0.55,
  },
};

/** Return a theme's name: the one that is asked for, else what the browser prefers. */
export function themeName(asked) {
  if (asked in THEMES) return asked;
  return globalThis.matchMedia?.("(prefers-color-scheme: light)").matches ? "light" : "dark";
}
