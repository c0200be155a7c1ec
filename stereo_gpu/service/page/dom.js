// Elements made in one line: make("p", { class: "soft" }, "text", child).

/** An element; functions among the attributes are listeners, false and null leave an attribute out. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** A button that does not send a form. */
export function button(text, click, attributes = {}) {
  return make("button", { type: "button", click, ...attributes }, text);
}

let count = 0;

/** A label and what it belongs to, with a hint that is read out with it. */
export function field(text, control, hint = "") {
  control.id ||= `field-${++count}`;
  const told = hint ? make("small", { id: `${control.id}-hint` }, hint) : null;
  if (told) control.setAttribute("aria-describedby", told.id);
  return make("p", { class: "field" }, make("label", { for: control.id }, text), control, told);
}

/** A list to choose from; `choices` are [value, text]. */
export function choice(choices, chosen, change = null) {
  const list = make("select", change ? { change } : {});
  for (const [value, text] of choices) list.append(make("option", { value, selected: value === chosen }, text));
  return list;
}

/** Set the text of an element only where it differs, so that nothing is read out twice. */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
  element.hidden = !text;
}

/** A line for errors, empty until there is one. */
export function alertLine() {
  return make("p", { class: "alert", role: "alert", hidden: true });
}
