// Numbers and times for people. Settings are kept in this browser only.
const METRES_PER_MILE = 1609.344;

export const settings = {
  unit: localStorage.getItem("unit") || "m",
  zone: localStorage.getItem("zone") || "local",
  theme: localStorage.getItem("theme") || "auto",
};

export function set(name, value) {
  settings[name] = value;
  localStorage.setItem(name, value);
}

// Two significant digits under 100, steps as an observer would say them above.
function rounded(metres) {
  if (metres < 100) return String(Math.round(metres));
  if (metres < 1000) return String(Math.round(metres / 10) * 10);
  return null;
}

export function length(metres) {
  if (metres === null || metres === undefined) return { value: "–", unit: "" };
  if (settings.unit === "mi") {
    const miles = metres / METRES_PER_MILE;
    return { value: miles < 1 ? miles.toFixed(2) : miles < 10 ? miles.toFixed(1) : miles.toFixed(0), unit: "mi" };
  }
  const small = rounded(metres);
  if (small !== null) return { value: small, unit: "m" };
  return { value: (metres / 1000).toFixed(metres < 10000 ? 1 : 0), unit: "km" };
}

export function lengthText(metres) {
  const { value, unit } = length(metres);
  return unit ? `${value} ${unit}` : value;
}

// 1 unit of the axis in metres.
export function axisUnit() {
  return settings.unit === "mi" ? METRES_PER_MILE : 1;
}

export function time(text, withDate = false) {
  if (!text) return "–";
  const date = new Date(text);
  const zone = settings.zone === "UTC" ? { timeZone: "UTC" } : {};
  const options = { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23", ...zone };
  if (withDate) Object.assign(options, { year: "numeric", month: "short", day: "2-digit" });
  return date.toLocaleString(undefined, options) + (settings.zone === "UTC" ? " UTC" : "");
}

export function age(seconds) {
  if (seconds < 90) return `${Math.round(seconds)} s ago`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min ago`;
  if (seconds < 172800) return `${Math.round(seconds / 3600)} h ago`;
  return `${Math.round(seconds / 86400)} days ago`;
}
