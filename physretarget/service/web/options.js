// The options of a job as fields: what each is called, what it does, what is taken if nothing is told.

const choice = (name, label, options, hint) => ({ name, label, options, hint });
const amount = (name, label, hint, more) => ({ name, label, hint, number: true, ...more });

const PROFILE = choice("profile", "Profile", [
  ["", "Animation (default)"], ["robot", "Robot"],
], "Animation forgives what viewers do not see. Robot also judges torques and joint limits as a machine’s.");
const IGNORE = { name: "ignore", label: "Ignore findings", placeholder: "CON002, DYN001", codes: true,
  hint: "Codes that are not to be reported, with commas between." };
const SELECT = { name: "select", label: "Only these findings", placeholder: "all", codes: true,
  hint: "Codes to be reported and no others." };
const FRICTION = amount("friction", "Friction", "Of the floor; by default what the model says.",
  { min: 0.01, max: 10, step: "any", placeholder: "from the model" });
const UP = choice("up", "Upward axis", [["", "from the file"], ["x", "x"], ["y", "y"], ["z", "z"]], "Where the capture’s file leaves it open.");

/** Fields by kind of job: those that most people need, and the others. */
export const FIELDS = {
  validate: {
    first: [
      PROFILE,
      amount("fps", "Frames per second", "Needed where the file carries none, as most CSV and NPY files.",
        { min: 0.1, max: 10000, step: "any", placeholder: "from the file" }),
      amount("lowpass", "Low-pass, Hz", "Smooths recorded or generated noise before judging; 6 suits most. None by default.",
        { min: 0.1, max: 1000, step: "any", placeholder: "none" }),
      choice("quat", "Quaternions", [["", "find out"], ["wxyz", "w x y z"], ["xyzw", "x y z w"]],
        "Order of the root’s rotation in files without a header."),
    ],
    more: [
      choice("joint_order", "Joint order", [["", "the model’s"], ["breadth-first", "breadth first"]],
        "Of files that name no joints; simulators differ."),
      FRICTION, IGNORE, SELECT,
    ],
  },
  retarget: {
    first: [
      PROFILE,
      amount("lowpass", "Low-pass, Hz", "Of the capture; 6 by default, 0 for none.", { min: 0, max: 1000, step: "any", placeholder: "6" }),
      choice("physics", "Physics", [["", "Default"], ["paper", "As in the paper"], ["convex", "Convex"]],
        "How the root’s height is made to obey gravity."),
      choice("mapper", "Mapping", [["", "SGPLVM (default)"], ["gp", "Gaussian process"], ["pca", "PCA"], ["nn3", "3 nearest"], ["nn10", "10 nearest"]],
        "How poses between the key poses are found."),
    ],
    more: [
      choice("heading", "Heading", [["", "The actor’s"], ["momentum", "From the momentum"]], "Where the character faces."),
      choice("tail", "Tail", [["", "Mapped"], ["passive", "Passive"]], "Passive tails swing by physics alone."),
      choice("unit", "Unit of the capture", [["", "find out"], ["m", "m"], ["cm", "cm"], ["mm", "mm"], ["inch", "inch"]], "Told, it is not guessed from the actor’s size."),
      UP,
      amount("mass", "Actor’s mass, kg", "Of the human in the capture.", { min: 1, max: 1000, step: "any", placeholder: "70" }),
      amount("seed", "Seed", "Of the mapping’s start; the same seed gives the same clip.", { min: 0, max: 2147483647, step: 1, placeholder: "0" }),
      IGNORE,
    ],
  },
};

/** What was entered, as the API takes it; what was left alone is left out. */
export function readOptions(kind, form) {
  const told = {};
  for (const field of [...FIELDS[kind].first, ...FIELDS[kind].more]) {
    const text = form.elements[`option-${field.name}`]?.value.trim() ?? "";
    if (!text) continue;
    if (field.number) told[field.name] = Number(text);
    else if (field.codes) told[field.name] = text.toUpperCase().split(/[\s,;]+/).filter(Boolean);
    else told[field.name] = text;
  }
  return told;
}

/** Options that came with a job and have no field here; kept when it is judged again. */
export function others(kind, options) {
  const known = new Set([...FIELDS[kind].first, ...FIELDS[kind].more].map((field) => field.name));
  return Object.fromEntries(Object.entries(options).filter(([name]) => !known.has(name)));
}
