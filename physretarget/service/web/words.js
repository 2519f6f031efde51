// Numbers, units and names as people read them; the same words as in the reports.

const NAMES = {
  unexplained_force_rms_bw: "Unexplained force, RMS",
  unexplained_force_max_bw: "Unexplained force, highest",
  unexplained_moment_rms_bwh: "Unexplained moment, RMS",
  unexplained_moment_max_bwh: "Unexplained moment, highest",
  required_force_vertical_max_bw: "Vertical force, highest",
  required_force_vertical_min_bw: "Vertical force, lowest",
  required_force_vertical_mean_bw: "Vertical force, mean",
  root_acceleration_max_m_s2: "Root acceleration, highest",
  pull_frames_fraction: "Frames in which the ground pulls",
  friction_exceeded_fraction: "Frames beyond friction",
  cop_outside_fraction: "Frames off balance",
  cop_outside_max_m: "Centre of pressure outside by",
  flight_frames_fraction: "Frames in flight",
  flight_com_acceleration_error_rms: "Flight, off ballistic by",
  flight_moment_rms_bwh: "Moment in flight, RMS",
  float_time_s: "Time afloat",
  penetration_max_m: "Deepest ground penetration",
  penetration_frames_fraction: "Frames in the ground",
  contact_chatter_per_s: "Contacts that chatter",
  skate_speed_max_m_s: "Fastest foot slide",
  skate_distance_m: "Way of sliding feet",
  joint_limit_excess_max_rad: "Beyond a joint limit",
  joint_speed_max_rad_s: "Fastest joint",
  joint_torque_ratio_max: "Joint torque, share of the limit",
  self_penetration_max_m: "Deepest self-penetration",
  jerk_dimensionless_max: "Jerk, dimensionless",
};
/** Measures that become tiles, the most telling first. */
export const TILES = [
  "unexplained_force_rms_bw", "required_force_vertical_max_bw", "penetration_max_m",
  "skate_speed_max_m_s", "float_time_s", "joint_speed_max_rad_s",
];
export const FORMATS = [
  ["html", "Report", "html", "one page with charts and replay"],
  ["json", "JSON", "json", "everything, for programs"],
  ["markdown", "Markdown", "md", "for a pull request"],
  ["text", "Text", "txt", "as on the command line"],
  ["sarif", "SARIF", "sarif", "for code scanning"],
  ["junit", "JUnit", "junit.xml", "for test reports"],
];

/** A measure's name in words; an unknown one is read as well as can be. */
export function measureName(name) {
  if (Object.hasOwn(NAMES, name)) return NAMES[name];
  const words = name.replaceAll("_", " ");
  return words.charAt(0).toUpperCase() + words.slice(1);
}

/** A number with some significant digits and a real minus sign. */
export function number(value, digits = 3) {
  if (typeof value !== "number" || !Number.isFinite(value)) return "–";
  if (Math.abs(value) < 1e-9) return "0";
  const size = Math.abs(value);
  const text = size >= 1e-4 && size < 1e6
    ? String(size >= 10 ** digits ? Math.round(value) : Number(value.toPrecision(digits)))
    : value.toExponential(digits - 1);
  return text.replace("-", "−");
}

/** Value and unit as read: fractions in per cent, small lengths in mm. */
export function quantity(value, unit) {
  if (typeof value === "number") {
    if (unit === "1" && Math.abs(value) <= 1) return [number(100 * value), "%"];
    if (unit === "m" && Math.abs(value) < 0.1) return [number(1000 * value), "mm"];
  }
  return [number(value), unit === "1" ? "" : pretty(unit)];
}
/** Both in the unit that suits the larger of the two. */
export function pair(left, right, unit) {
  const known = [left, right].filter((v) => typeof v === "number").map(Math.abs);
  const most = Math.max(0, ...known);
  if (unit === "1" && most <= 1) return [number(100 * left), number(100 * right), "%"].map(ofNull(left, right));
  if (unit === "m" && most < 0.1) return [number(1000 * left), number(1000 * right), "mm"].map(ofNull(left, right));
  return [number(left), number(right), unit === "1" ? "" : pretty(unit)];
}
const ofNull = (left, right) => (text, i) => (i === 0 && left === null) || (i === 1 && right === null) ? "–" : text;
const pretty = (unit) => String(unit ?? "").replace("^2", "²").replace("^3", "³").replace("BW h", "BW·h");

export const plural = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
export const counts = (summary) => `${plural(summary.errors, "error")} · ${plural(summary.warnings, "warning")}`;

/** The options of a job in a few words, so that two jobs of one clip can be told apart. */
export function optionsTold(options) {
  const said = { profile: (v) => v, lowpass: (v) => `low-pass ${v} Hz`, fps: (v) => `${v} fps`, mapper: (v) => v, physics: (v) => `${v} physics` };
  return Object.entries(options).map(([name, value]) => Object.hasOwn(said, name) ? said[name](value) : name.replaceAll("_", " "));
}

export function bytes(size) {
  if (size < 1000) return `${size} B`;
  const units = ["kB", "MB", "GB"], step = Math.min(2, Math.floor(Math.log10(size) / 3) - 1);
  return `${number(size / 1000 ** (step + 1))} ${units[step]}`;
}

const relative = new Intl.RelativeTimeFormat("en", { numeric: "auto", style: "short" });
/** How long ago, in the largest unit that fits. */
export function ago(moment) {
  const seconds = (Date.parse(moment) - Date.now()) / 1000;
  if (seconds > -45) return "just now";
  for (const [unit, size, most] of [["minute", 60, 60], ["hour", 3600, 24], ["day", 86400, 60]]) {
    if (-seconds / size < most) return relative.format(Math.round(seconds / size), unit);
  }
  return new Date(moment).toLocaleDateString();
}
export const exact = (moment) => new Date(moment).toLocaleString();
export function took(job) {
  if (!job.started || !job.finished) return "";
  return `${number((Date.parse(job.finished) - Date.parse(job.started)) / 1000, 2)} s`;
}
export const KINDS = { validate: "judged", retarget: "retargeted" };
/** Statuses as read: a clip that fails its rules has been judged, a job that fails has not. */
export const STATUSES = { queued: "waiting", running: "running", done: "finished", failed: "not judged", cancelled: "cancelled" };
