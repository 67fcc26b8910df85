// The run's time: it plays, stands, and is put anywhere; pieces are asked for as they are needed.

const KEPT = 6;

/**
 * `load(i)` returns a promise of the messages of a piece; `show(messages, anew)` is given what has
 * come since it was called last, or, `anew`, all that is true at the time that was gone to.
 */
export function createPlayer({ length, pieceLength, load, show }) {
  const pieces = new Map();
  const last = Math.floor(length / pieceLength);
  let time = 0;
  let shownTo = null;
  let playing = false;
  let speed = 1;

  const indexAt = (t) => Math.min(last, Math.max(0, Math.floor(t / pieceLength)));

  function want(i) {
    if (i > last || pieces.has(i)) return;
    pieces.set(i, null);
    load(i).then((messages) => pieces.set(i, messages), () => pieces.delete(i));
    for (const far of [...pieces.keys()]) {
      if (pieces.size > KEPT && Math.abs(far - i) > 1) pieces.delete(far);
    }
  }

  /** Show everything up to a time whose piece is there; return whether it is. */
  function showTo(t) {
    const i = indexAt(t);
    want(i);
    const messages = pieces.get(i);
    if (!messages) return false;
    want(i + 1);
    const anew = shownTo === null || t < shownTo || indexAt(shownTo) !== i;
    const from = anew ? -1 : shownTo;
    const due = messages.filter((message) => message.t > from && message.t <= t + 1e-6);
    shownTo = t;
    if (due.length) show(due, anew);
    return true;
  }

  return {
    get time() { return time; },
    get playing() { return playing; },
    get length() { return length; },
    play() {
      if (time >= length) this.seek(0);
      playing = true;
    },
    pause() { playing = false; },
    setSpeed(factor) { speed = factor; },
    seek(t) {
      time = Math.min(length, Math.max(0, t));
      shownTo = null;
    },
    /** Let time pass [s]; it stands while what is to be shown has not come. */
    step(dt) {
      const next = playing ? Math.min(length, time + speed * dt) : time;
      if (next === shownTo) return;
      if (showTo(next)) time = next;
      if (time >= length) playing = false;
    },
  };
}
