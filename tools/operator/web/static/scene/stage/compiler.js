/**
 * Compiles what is to be drawn before it is drawn, while the page goes on.
 *
 * A program that is used at once lets the page wait until the browser has compiled it: seconds
 * without a graphics processor, in which a key that is let go of is not heard. So the browser's
 * drawing process is told of new programs, and they are used once it has come so far.
 */

/** `fence()` is called when programs were told; it returns a function that says if all is done. */
export function createCompiler(renderer, scene, camera, fence) {
  let known = new WeakSet();
  let told = null;
  let fresh = [];

  function unknown() {
    const found = [];
    scene.traverse(({ material }) => {
      for (const each of [material].flat()) if (each && !known.has(each)) found.push(each);
    });
    return found;
  }

  return {
    /** Return whether all that there is can be drawn at once; if not, it is being compiled. */
    ready() {
      if (told) {
        if (!told()) return false;
        told = null;
        // What each is given is asked for one at a time: each is an answer to be waited for.
        fresh = [...renderer.info.programs];
      }
      if (fresh.length) {
        fresh.pop().getUniforms();
        return false;
      }
      const materials = unknown();
      if (!materials.length) return true;
      for (const each of materials) known.add(each);
      renderer.compile(scene, camera);
      told = fence();
      return false;
    },
    /** Compile all anew: lights have changed. */
    forget() { known = new WeakSet(); },
  };
}
