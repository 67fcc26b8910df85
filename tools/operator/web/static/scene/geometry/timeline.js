/**
 * Plays states back evenly, a little late: they come in bunches, and a page draws when it can.
 *
 * The sender's clock is where the quickest messages say; drawing is behind it by about as much as
 * messages lately were late. Between two states everything is interpolated; nothing is foreseen.
 */

const LEAST_DELAY_S = 0.02;
const MOST_DELAY_S = 0.25;
/** How quickly the delay grows with lateness, and shrinks without (of what is left, per message). */
const GROW = 0.3;
const SHRINK = 0.01;
/** Drawn time runs faster or slower by at most this part, to get to where it should be. */
const EASE = 0.06;
/** Beyond this it leaps [s]. */
const LEAP_S = 0.3;
/** A clock that is off by more has started anew [s]. */
const ANEW_S = 2;
const KEPT = 60;

export function createTimeline() {
  let states = [];
  let offset = null;
  let delay = 0.04;
  let played = null;
  let drawn = 0;

  /** Return the time to draw at `now`: evenly on from the last, and eased to where it should be. */
  function playhead(now) {
    const wanted = now - offset - delay;
    const even = (played ?? wanted) + now - drawn;
    const most = EASE * (now - drawn);
    played = played === null || Math.abs(wanted - even) > LEAP_S
      ? wanted : even + Math.min(most, Math.max(-most, wanted - even));
    drawn = now;
    return played;
  }

  return {
    /** Take in a state with its time [s], at `now` [s] of the page's clock. */
    push(time, state, now) {
      const last = states.at(-1);
      if (offset === null || time < (last?.time ?? time) || Math.abs(now - time - offset) > ANEW_S) {
        states = [];
        offset = now - time;
        played = null;
      }
      if (last && states.length && time === last.time) return;
      // Clocks drift apart: the least lateness is forgotten slowly.
      offset = Math.min(now - time, offset + 2e-5);
      const late = now - time - offset;
      const gap = states.length ? time - states.at(-1).time : 0;
      const wanted = Math.min(MOST_DELAY_S, Math.max(LEAST_DELAY_S, late + 1.2 * gap));
      delay += (wanted > delay ? GROW : SHRINK) * (wanted - delay);
      states.push({ time, state });
      if (states.length > KEPT) states.shift();
    },

    /** Return the two states around what is drawn at `now`, and how far it is between them. */
    sample(now) {
      if (!states.length) return null;
      const time = playhead(now);
      while (states.length > 2 && states[1].time <= time) states.shift();
      const [a, b] = states.length > 1 ? states : [states[0], states[0]];
      const span = b.time - a.time;
      const part = span > 0 ? Math.min(1, Math.max(0, (time - a.time) / span)) : 1;
      return { a: a.state, b: b.state, part, time: a.time + part * span };
    },

    newest: () => states.at(-1)?.state ?? null,
    delay: () => delay,
  };
}

/** Return numbers a part of the way from a to b; those of b where lengths differ or one is none. */
export function mixed(a, b, part) {
  if (!a || !b || a.length !== b.length) return b ?? a;
  return b.map((y, i) => (Number.isFinite(a[i]) && Number.isFinite(y) ? a[i] + part * (y - a[i]) : y));
}
