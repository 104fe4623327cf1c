// The dashboard: fetches once, then lives by the event stream.
import { age, length, lengthText, set, settings, time } from "./format.js";
import { Series, drawProfile } from "./series.js";
import { follow, getJson, getObservations, getPicture, signIn } from "./station.js";

const $ = (id) => document.getElementById(id);
const state = { camera: "", cameras: [], lights: [], current: null, received: 0, receivedWall: 0, connected: false, locked: false, selected: "", pictureUrl: "" };
const series = new Series($("series"), $("legend"));
const MOST_EVENTS = 200;
const OLD_S = 6 * 3600;  // not stale by the station's own limit, and yet not of today: an archive's replay

function text(id, value) {
  if ($(id).textContent !== value) $(id).textContent = value;
}

// The age grows here between messages: the page must not look fresh because nothing comes. By the clock that runs on while
// the computer sleeps, where there is one, and by the one that nobody sets.
function ageSeconds() {
  const passed = Math.max(performance.now() - state.received, Date.now() - state.receivedWall);
  return state.current.ageSeconds + passed / 1000;
}

function isStale() {
  return state.current !== null && (state.current.stale || ageSeconds() > state.current.staleAfterSeconds);
}

function showNotice() {
  const parts = [];
  if (state.locked) parts.push("This station shows nothing without a token.");
  else if (!state.connected) parts.push("No connection to the station; what you see is the last that came.");
  if (isStale()) parts.push(`Stale: the last frame is ${age(ageSeconds())}. It does not say what the air is like now.`);
  else if (state.current && ageSeconds() > OLD_S)
    parts.push(`A replay: its latest frame is of ${time(state.current.timestamp, true)}. It does not say what the air is like now.`);
  text("notice", parts.join(" "));
  $("notice").hidden = parts.length === 0;
  document.body.classList.toggle("stale", isStale() || !state.connected);
}

function showAge() {
  if (state.current) text("age", age(ageSeconds()));
  showNotice();
}

// "fog, 97 % sure": the probability of the class that is told.
function weatherText(c) {
  const sure = c.weatherProbability && c.weatherProbability[c.weather];
  return sure ? `${c.weather}, ${Math.floor(100 * sure)} % sure` : c.weather;
}

// Half of the 95 % range beside the value; a limit has none.
function uncertaintyText(v) {
  if (v.limit || v.value === null || v.minValue === null || v.maxValue === null) return "";
  return ` (±${Math.round((50 * (v.maxValue - v.minValue)) / v.value)} %)`;
}

function bandText(v) {
  if (v.minValue === null && v.maxValue === null) return "–";
  if (v.maxValue === null) return `above ${lengthText(v.minValue)}`;
  if (v.minValue === null) return `below ${lengthText(v.maxValue)}`;
  return `${lengthText(v.minValue)} to ${lengthText(v.maxValue)}${uncertaintyText(v)}`;
}

function showNow() {
  const c = state.current;
  if (!c) return;
  // "Now" says nothing of what is long past; the picture and the series say their own times, lamps are "unknown".
  const stale = isStale();
  const v = c.visibility;
  const shown = length(stale ? null : v.value);
  text("limit", stale ? "" : { above: "at least ", below: "at most " }[v.limit] || "");
  text("value", shown.value);
  text("value-unit", shown.unit);
  text("weather", stale ? "" : weatherText(c));
  text("trend", c.trend && !stale ? `· ${{ improving: "↗ improving", steady: "→ steady", worsening: "↘ worsening" }[c.trend]}` : "");
  text("band", stale ? "–" : bandText(v));
  const mean = !stale && c.tenMinutes && c.tenMinutes.visibility;
  text("mean", mean ? ({ above: "at least ", below: "at most " }[mean.limit] || "") + lengthText(mean.value) : "–");
  text("time", time(c.timestamp, true));
  text("used", stale ? "–" : String(c.lightsUsed));
  text("metar", stale ? "–" : c.rawMessage);
  text("quality", [c.reason, ...c.quality.map((flag) => flag.replaceAll("_", " "))].filter(Boolean).join("; ") || "none");
  text("station", c.station);
  document.title = stale || v.value === null ? `– · ${c.station}` : `${$("limit").textContent}${lengthText(v.value)} · ${c.station}`;
  showAge();
}

function takeCurrent(properties) {
  if (properties.ageSeconds === undefined) return;  // something missed, or long past
  if (state.current && properties.camera === state.current.camera && properties.timestamp < state.current.timestamp &&
      properties.ageSeconds > ageSeconds()) return;  // a late one
  state.current = properties;
  state.received = performance.now();
  state.receivedWall = Date.now();
  showNow();
}

// Another camera: nothing of the last one's may stand under its name.
function forgetCamera() {
  state.current = null;
  state.lights = [];
  state.selected = "";
  $("profile-box").hidden = true;
  for (const id of ["value", "band", "mean", "time", "age", "used", "metar", "quality"]) text(id, "–");
  for (const id of ["limit", "value-unit", "trend", "weather"]) text(id, "");
  document.title = "lampglow";
  series.set([]);
  text("legend", "");
  $("lights").replaceChildren();
  $("marks").replaceChildren();
  showPicture({});
  showNotice();
}

// The answer, unless another camera was chosen while it was on its way.
async function ofThisCamera(answer) {
  const camera = state.camera;
  const result = await answer;
  return camera === state.camera ? result : null;
}

function toSeriesRow(p) {
  return { time_utc: p.timestamp, mor_m: p.visibility.value, mor_low_m: p.visibility.minValue, mor_high_m: p.visibility.maxValue,
           limit: p.visibility.limit, weather: p.weather, reason: p.reason };
}

async function loadCurrent() {
  const camera = state.camera;
  try {
    const answer = await ofThisCamera(getJson(`/v1/current?camera=${encodeURIComponent(camera)}`, "no-store"));
    if (answer) takeCurrent(answer.properties);
  } catch (error) {
    if (camera !== state.camera) return;
    if (error.status === 503) text("weather", "waiting for the first frame");
    if (error.status === 401) text("weather", "needs a token");
  }
}

// Up to the newest frame, which an archive's replay may have long ago.
async function loadSeries() {
  const end = state.current ? Date.parse(state.current.timestamp) + 1000 : Date.now();
  const iso = (ms) => new Date(ms).toISOString().replace(/\.\d+Z/, "Z");
  const camera = state.camera;
  try {
    const rows = await ofThisCamera(getObservations(camera, iso(end - 86400e3), iso(end + 1000), "raw"));
    if (rows) series.set(rows);
  } catch (error) {
    if (camera === state.camera) series.set(state.current ? [toSeriesRow(state.current)] : []);
  }
}

function showPicture({ blob, time: taken, locked }) {
  $("picture").hidden = !blob;
  $("marks").hidden = !blob;
  $("no-picture").hidden = Boolean(blob);
  $("sign-in").hidden = !locked && !state.locked;
  text("no-picture", locked ? "Pictures need a token." : "No picture yet.");
  text("picture-time", blob && taken ? time(taken, true) : "");
  if (state.pictureUrl) URL.revokeObjectURL(state.pictureUrl);
  state.pictureUrl = blob ? URL.createObjectURL(blob) : "";
  if (blob) $("picture").src = state.pictureUrl;
}

async function loadPicture() {
  const picture = await ofThisCamera(getPicture(
    `/v1/frames/latest.jpg?camera=${encodeURIComponent(state.camera)}&annotated=${$("annotated").checked}`));
  if (picture) showPicture(picture);
}

function lightButton(light) {
  const button = document.createElement("button");
  button.type = "button";
  button.dataset.light = light.id;
  button.addEventListener("click", () => showProfile(light.id));
  return button;
}

function placeMark(light, camera) {
  const button = lightButton(light);
  button.setAttribute("aria-label", `Lamp ${light.id}, ${light.state}: show its ring profile`);
  button.title = `${light.id}: ${light.state}`;
  button.setAttribute("aria-pressed", String(light.id === state.selected));
  button.style.left = `${(100 * (light.fit ? light.fit.x : light.x)) / camera.width}%`;
  button.style.top = `${(100 * (light.fit ? light.fit.y : light.y)) / camera.height}%`;
  return button;
}

async function loadLights() {
  const answer = await ofThisCamera(getJson(`/v1/lights?camera=${encodeURIComponent(state.camera)}`));
  if (!answer) return;
  const { lights } = answer;
  const focused = document.activeElement && document.activeElement.dataset.light;
  const inMarks = $("marks").contains(document.activeElement);
  $("lights").replaceChildren(...lights.map((light) => {
    const button = lightButton(light);
    button.setAttribute("aria-pressed", String(light.id === state.selected));
    const word = document.createElement("span");
    word.className = `state ${light.state}`;
    word.textContent = light.state;
    const far = light.distance.value === null ? "" : ` ${lengthText(light.distance.value)}`;
    button.append(`${light.id}${far} `, word);
    const item = document.createElement("li");
    item.append(button);
    return item;
  }));
  const camera = state.cameras.find((one) => one.camera === state.camera);
  $("marks").replaceChildren(...(camera && camera.width ? lights.map((light) => placeMark(light, camera)) : []));
  if (focused) {
    const again = (inMarks ? $("marks") : $("lights")).querySelector(`[data-light="${CSS.escape(focused)}"]`);
    if (again) again.focus();
  }
  state.lights = lights;
}

async function showProfile(id) {
  state.selected = id;
  for (const button of document.querySelectorAll("#lights button, #marks button"))
    button.setAttribute("aria-pressed", String(button.dataset.light === id));
  $("profile-box").hidden = false;
  text("profile-title", `Lamp ${id}: ring profile`);
  const light = state.lights.find((one) => one.id === id);
  const fit = light && light.fit;
  const number = (value, digits = 2) => (value === null ? "–" : value.toFixed(digits));
  try {
    const profile = await ofThisCamera(getJson(`/v1/lights/${encodeURIComponent(id)}/profile?camera=${encodeURIComponent(state.camera)}`));
    if (!profile || state.selected !== id) return;
    drawProfile($("profile"), profile);
    text("profile-facts", ["Across: angle from the lamp; up: radiance; both logarithmic. Points and band: measured, ±1 σ; line: fit.",
      fit ? `σR ${number(fit.opticalThickness)}, strength ${number(fit.strengthRatio)} × reference, residual ${number(fit.residualRms)} σ.` : "",
      time(profile.timestamp)].join(" "));
  } catch (error) {
    $("profile").textContent = "";
    text("profile-facts", "No ring profile of this lamp is kept.");
  }
}

function fact(name, value, kind = "") {
  const box = document.createElement("div");
  const term = document.createElement("dt");
  const word = document.createElement("dd");
  term.textContent = name;
  word.textContent = value;
  word.className = kind;
  box.append(term, word);
  return box;
}

async function loadHealth() {
  const [{ cameras }, health] = await Promise.all([getJson("/v1/cameras"), getJson("/healthz")]);
  state.cameras = cameras;
  const facts = [fact("Station", health.status, health.status === "ok" ? "good" : "bad")];
  for (const fault of health.faults) facts.push(fact("Fault", fault, "bad"));
  for (const camera of cameras) {
    const s = camera.sensor;
    facts.push(fact(camera.camera, s.up ? "camera up" : s.fault ? s.fault.replaceAll("_", " ") : "camera down", s.up ? "good" : "bad"));
    if (s.message) facts.push(fact("Message", s.message));
    if (s.nextDue) facts.push(fact("Next frame", time(s.nextDue)));
  }
  $("health").replaceChildren(...facts);
}

function eventItem(event) {
  const item = document.createElement("li");
  const when = document.createElement("time");
  when.dateTime = event.time;
  when.textContent = time(event.time, true) + (event.camera ? ` · ${event.camera}` : "");
  const words = document.createElement("span");
  words.className = event.severity;
  words.textContent = event.message;
  item.append(when, words);
  return item;
}

async function loadEvents() {
  try {
    const { events } = await getJson("/v1/events?limit=50");
    $("events").replaceChildren(...events.reverse().map(eventItem));
    if (!events.length) $("events").textContent = "None yet.";
  } catch (error) {
    $("events").textContent = "This station keeps no events.";
  }
}

async function loadAll() {
  await loadHealth();
  if (!state.camera && state.cameras.length) state.camera = state.cameras[0].camera;
  $("camera-label").hidden = state.cameras.length < 2;
  $("camera").replaceChildren(...state.cameras.map((c) => new Option(c.camera, c.camera, false, c.camera === state.camera)));
  await loadCurrent();
  await Promise.all([loadSeries(), loadLights(), loadPicture(), loadEvents()]);
}

// Runs `work` at once, and once more after it if it was asked for meanwhile: a hundred messages that come together
// ask the station twice, not a hundred times.
function atMostOneAtATime(work) {
  let running = false, again = false;
  return async () => {
    again = true;
    if (running) return;
    running = true;
    while (again) {
      again = false;
      await work().catch((error) => console.info(error.message));
    }
    running = false;
  };
}

const refreshHealth = atMostOneAtATime(loadHealth);
const refreshFrame = atMostOneAtATime(async () => {
  series.draw();
  await Promise.all([loadCurrent(), loadLights(), loadPicture(), loadHealth()]);
  if (state.selected) await showProfile(state.selected);
});

function onMessage(type, data) {
  if (type === "event") {
    if (!$("events").children.length) $("events").textContent = "";
    $("events").prepend(eventItem(data));
    while ($("events").children.length > MOST_EVENTS) $("events").lastElementChild.remove();
    refreshHealth();
  } else if (data.properties.camera === state.camera) {
    takeCurrent(data.properties);
    series.add(toSeriesRow(data.properties));
    refreshFrame();
  }
}

const refreshAll = atMostOneAtATime(loadAll);

function onConnection(how) {
  const connected = how === "connected";
  const back = connected && !state.connected;
  state.connected = connected;
  state.locked = how === "locked";
  if (state.locked) $("sign-in").hidden = false;
  showNotice();
  if (back) refreshAll();
}

const THEMES = ["auto", "light", "dark", "night"];
function showSettings() {
  document.documentElement.dataset.theme = settings.theme;
  text("unit", settings.unit);
  text("zone", settings.zone);
  text("theme", settings.theme);
  $("unit").setAttribute("aria-label", `Unit of length: ${settings.unit === "m" ? "metres; change to miles" : "miles; change to metres"}`);
  $("zone").setAttribute("aria-label", `Times: ${settings.zone}; change`);
  $("theme").setAttribute("aria-label", `Colours: ${settings.theme}; change`);
}

function changeSetting(name, value) {
  set(name, value);
  showSettings();
  showNow();
  series.draw();
  if (state.selected && !$("profile-box").hidden) showProfile(state.selected);
  if (state.camera) Promise.all([loadLights(), loadHealth(), loadEvents()]).catch((error) => console.info(error.message));
}

$("unit").addEventListener("click", () => changeSetting("unit", settings.unit === "m" ? "mi" : "m"));
$("zone").addEventListener("click", () => changeSetting("zone", settings.zone === "UTC" ? "local" : "UTC"));
$("theme").addEventListener("click", () => changeSetting("theme", THEMES[(THEMES.indexOf(settings.theme) + 1) % THEMES.length]));
$("annotated").addEventListener("change", () => loadPicture().catch((error) => console.info(error.message)));
$("sign-in").addEventListener("click", () => { signIn(); refreshAll(); });
$("camera").addEventListener("change", () => { state.camera = $("camera").value; forgetCamera(); refreshAll(); });
showSettings();
setInterval(showAge, 1000);
setInterval(() => { if (isStale()) showNow(); }, 5000);
follow(onMessage, onConnection);
