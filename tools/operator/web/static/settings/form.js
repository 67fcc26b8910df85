// A form for any message, made from the schema of its fields.

import { button, el } from "../dom.js";

const FILLED = ["seen_tick", "task", "mechanism", "operator", "key", "seal", "opens"];

function resolved(schema, root) {
  if (schema.$ref) return resolved(root.$defs[schema.$ref.split("/").pop()], root);
  if (schema.anyOf) {
    const some = schema.anyOf.filter((each) => each.type !== "null");
    return { ...resolved(some[0], root), optional: some.length < schema.anyOf.length };
  }
  return schema;
}

/** Units of fields by name; a field's own axes are linear first. */
const UNITS = {
  twist: "m/s, rad/s", xyz: "m", rpy: "rad", wrench: "N, N·m", rates: "rad/s, m/s", q: "rad", speed: "m/s",
  speeds: "m/s", blend: "m", durations_s: "s", depth: "m", mass: "kg", com: "m", bias: "N, N·m", factor: "1", handle: "m, rad",
};

const number = (text) => (text.trim() === "" ? undefined : Number(text.replace(",", ".")));

// An input of one field: {node, read}; `read` gives undefined for a field that is left out.
function input(name, given, root) {
  const schema = resolved(given, root);
  const label = name.replaceAll("_", " ");
  if (schema.type === "boolean") {
    const box = el("input", { type: "checkbox", "aria-label": label, checked: given.default === true });
    return { node: box, read: () => box.checked };
  }
  const options = schema.enum ?? (schema.const !== undefined ? [schema.const] : null);
  if (options) {
    const empty = schema.optional || "default" in given;
    const list = el("select", { "aria-label": label }, ...(empty ? [el("option", { value: "" }, "as it is")] : []),
      ...options.map((value) => el("option", { value }, value)));
    return { node: list, read: () => list.value || undefined };
  }
  if (schema.type === "number" || schema.type === "integer") {
    const field = el("input", { type: "text", inputMode: "decimal", "aria-label": label, size: 8, value: given.default ?? "" });
    return { node: field, read: () => number(field.value) };
  }
  if (schema.type === "array" && schema.prefixItems) {
    const fields = schema.prefixItems.map((_, i) => el("input", {
      type: "text", inputMode: "decimal", "aria-label": `${label} ${i + 1}`, value: given.default?.[i] ?? "" }));
    return { node: el("div", { className: "numbers" }, ...fields), read() {
      const values = fields.map((field) => number(field.value));
      return values.every((value) => value === undefined) ? undefined : values.map((value) => value ?? 0);
    } };
  }
  if (schema.type === "array") {
    const field = el("textarea", { rows: 2, "aria-label": `${label}, as JSON`, placeholder: "[…]" });
    return { node: field, read: () => (field.value.trim() ? JSON.parse(field.value) : undefined) };
  }
  const field = el("input", { type: "text", "aria-label": label, maxLength: schema.maxLength ?? 200, value: given.default ?? "" });
  return { node: field, read: () => field.value.trim() || undefined };
}

export function createForm(topic, { ask, choices }) {
  const { properties, ...root } = topic.schema;
  const inputs = Object.entries(properties).filter(([name]) => !FILLED.includes(name))
    .map(([name, schema]) => [name, input(name, schema, root)]);
  const refusal = el("span", { className: "refusal", role: "status" });

  async function send(event) {
    event.preventDefault();
    const fields = { ...("task" in properties ? choices.task : {}), ...("mechanism" in properties ? choices.mechanism : {}) };
    try {
      for (const [name, { read }] of inputs) {
        const value = read();
        if (value !== undefined) fields[name] = value;
      }
    } catch (error) {
      refusal.textContent = String(error.message);
      return;
    }
    const reply = await ask(topic.key, fields, refusal);
    if (reply.ok && topic.answered) {
      refusal.classList.add("done");
      refusal.textContent = "done";
    }
  }

  return el("form", { onsubmit: send },
    el("p", { className: "dim" }, topic.title),
    ...inputs.map(([name, { node }]) => el("div", { className: "field-row" },
      el("label", {}, name.replaceAll("_", " ").replace(/ s$/, ""), UNITS[name] ? el("small", {}, ` [${UNITS[name]}]`) : ""), node)),
    el("div", { className: "row" }, button("Send", () => {}, { type: "submit" })), refusal);
}
