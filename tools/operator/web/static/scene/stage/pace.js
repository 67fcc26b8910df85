/**
 * When to draw: never before the last picture is done, and where pictures are dear, only half of
 * the time.
 *
 * The browser draws in a process of its own. Told of more pictures than it can draw, it makes the
 * page wait, and a key that is let go of with it; and without a graphics processor it draws with
 * the cores that the page, the console and the daemon need.
 */

/** A picture that is done within this is no reason to rest [ms]. */
const QUICK_MS = 34;

/** `fence()` is called when a picture was asked for; it returns a function that says if it is done. */
export function createPace(fence) {
  let done = null;
  let begun = 0;
  let restsUntil = -Infinity;
  return {
    begun(now) {
      begun = now;
      done = fence();
    },
    /** Return how long the picture took that is done since [ms]; null if none is. */
    took(now) {
      if (!done || !done()) return null;
      done = null;
      const took = now - begun;
      restsUntil = took > QUICK_MS ? now + took : -Infinity;
      return took;
    },
    may: (now) => done === null && now >= restsUntil,
  };
}

/** Return the fence of a WebGL 2 context: it says whether all that was asked before is drawn. */
export function fenceOf(gl) {
  return () => {
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    return () => {
      if (sync && gl.clientWaitSync(sync, 0, 0) === gl.TIMEOUT_EXPIRED) return false;
      gl.deleteSync(sync);
      return true;
    };
  };
}
