// Requests with the refusal's reason shown at the control that was refused.

export function asker(link) {
  // Commands are answered by silence, or by an event that names their topic: who sent last shows it.
  const senders = new Map();
  link.addEventListener("event", ({ detail }) => {
    if (detail.name !== "command_refused") return;
    const place = senders.get(detail.values.topic);
    if (place) show(place, `${detail.sentence} ${detail.next}`);
  });

  function show(place, words) {
    place.classList.toggle("done", words === "done");
    place.textContent = words;
  }

  return async function ask(key, fields, place = null) {
    if (place) {
      senders.set(key, place);
      show(place, "");
    }
    const reply = await link.send(key, fields);
    if (place) show(place, reply.ok ? "" : reply.words || reply.reason);
    return reply;
  };
}
