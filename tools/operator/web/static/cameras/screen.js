/** The video of one camera: H.264 decoded by the browser (WebCodecs), each frame drawn at once. */

/** So many frames that wait for the decoder are too many: it goes on with the next key frame. */
const MOST_WAITING = 8;
/** A decoder that breaks is made anew so often; then small pictures are shown. */
const TRIES = 3;
const BASELINE = "avc1.42c01f";

/** Resolves with whether this browser decodes H.264. */
export const canDecode = (async () => {
  try {
    return (await VideoDecoder.isConfigSupported({ codec: BASELINE, optimizeForLatency: true })).supported;
  } catch {
    return false; // it has no WebCodecs, or is told of this page in the clear
  }
})();

/** Return the codec's name from the parameter sets that a key frame begins with; null if it has none. */
export function codecOf(data) {
  for (let i = 0; i + 6 < data.length; i++) {
    if (data[i] === 0 && data[i + 1] === 0 && data[i + 2] === 1 && (data[i + 3] & 31) === 7) {
      return `avc1.${[...data.subarray(i + 4, i + 7)].map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
    }
  }
  return null;
}

/** `shown(tick)` is called when a frame has been drawn, `broken()` when no more will be. */
export function createScreen(canvas, { shown, broken }) {
  const paint = canvas.getContext("2d", { alpha: false });
  let decoder = null;
  let codec = null;
  let tries = 0;

  function draw(frame) {
    if (canvas.width !== frame.displayWidth || canvas.height !== frame.displayHeight) {
      [canvas.width, canvas.height] = [frame.displayWidth, frame.displayHeight];
    }
    paint.drawImage(frame, 0, 0);
    const tick = frame.timestamp;
    frame.close();
    tries = 0;
    shown(tick);
  }

  function end() {
    if (decoder && decoder.state !== "closed") decoder.close();
    decoder = codec = null;
  }

  function failed() {
    decoder = codec = null;
    tries += 1;
    if (tries >= TRIES) broken();
  }

  return {
    push({ key, tick, data }) {
      if (tries >= TRIES) return;
      if (decoder && decoder.decodeQueueSize > MOST_WAITING) end();
      try {
        if (key) {
          const now = codecOf(data);
          if (!decoder || now !== codec) {
            end();
            codec = now;
            const mine = new VideoDecoder({ output: draw, error: () => mine === decoder && failed() });
            decoder = mine;
            decoder.configure({ codec, optimizeForLatency: true });
          }
        }
        if (!decoder) return; // a frame that needs one before it
        decoder.decode(new EncodedVideoChunk({ type: key ? "key" : "delta", timestamp: tick, data }));
      } catch {
        end();
        failed();
      }
    },
    end,
  };
}
