// Talks to the station: requests with the token, if one is needed, and the event stream with resume.
let token = sessionStorage.getItem("token") || "";
let asking = null;

function headers(extra) {
  return token ? { ...extra, Authorization: `Bearer ${token}` } : { ...extra };
}

// Pictures may need a token where everything else does not: nobody is asked for theirs unasked.
const isPicture = (path) => path.startsWith("/v1/frames");
let wanted = false;    // by the button
let declined = false;  // who says no is not asked again, but by the button
let wake = () => {};

function askForToken() {
  if (asking) return asking;
  const dialog = document.getElementById("login");
  asking = new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      if (dialog.returnValue === "given") {
        token = document.getElementById("token").value.trim();
        sessionStorage.setItem("token", token);
      } else {
        declined = true;
      }
      wanted = false;
      asking = null;
      resolve();
    }, { once: true });
    dialog.returnValue = "";
    dialog.showModal();
  });
  return asking;
}

export function signIn() {
  wanted = true;
  declined = false;
  wake();
}

const LONGEST_MS = 30e3;  // one request that hangs must not hold up all that follow it

// `cache`: "no-store" where the answer counts from the moment it was made.
async function request(path, { extra = {}, cache = "no-cache", signal } = {}) {
  for (;;) {
    const response = await fetch(path, { headers: headers(extra), cache, signal: signal || AbortSignal.timeout(LONGEST_MS) });
    if (response.status !== 401 || declined || (isPicture(path) && !wanted)) return response;
    await askForToken();
  }
}

export async function getJson(path, cache) {
  const response = await request(path, { cache });
  if (!response.ok) {
    const error = new Error(`${path}: ${response.status}`);
    error.status = response.status;
    throw error;
  }
  return response.json();
}

// The picture and its time; neither where there is none, `locked` where a token is missing.
export async function getPicture(path) {
  const response = await request(path);
  if (!response.ok) return { locked: response.status === 401 };
  return { blob: await response.blob(), time: response.headers.get("Last-Modified") };
}

// All pages of a range.
export async function getObservations(camera, from, to, step) {
  const rows = [];
  let next = `/v1/observations?camera=${encodeURIComponent(camera)}&from=${from}&to=${to}&step=${step}&limit=2000`;
  while (next) {
    const page = await getJson(next);
    rows.push(...page.observations);
    next = page.next;
  }
  return rows;
}

function parseMessage(text) {
  const message = { event: "message", data: "", id: null };
  for (const line of text.split("\n")) {
    const colon = line.indexOf(":");
    if (colon <= 0) continue;
    const value = line.slice(colon + 1).replace(/^ /, "");
    if (line.slice(0, colon) === "data") message.data += value;
    else message[line.slice(0, colon)] = value;
  }
  return message;
}

const SILENCE_MS = 45e3;  // three of the station's heartbeats: the connection is dead, whatever the system thinks

// fetch rather than EventSource, which can send no token. Calls back with every message and with "connected", "lost" or
// "locked" (a token is missing) as the connection comes and goes; tries again for ever.
export async function follow(onMessage, onConnection) {
  let last = "";
  for (let wait = 1000; ; wait = Math.min(wait * 2, 30000)) {
    const silence = new AbortController();
    let timer = 0, state = "lost";
    const heard = () => {
      clearTimeout(timer);
      timer = setTimeout(() => silence.abort(), SILENCE_MS);
    };
    try {
      heard();
      const response = await request("/v1/stream", { extra: last ? { "Last-Event-ID": last } : {}, signal: silence.signal });
      if (response.status === 401) state = "locked";
      if (!response.ok) throw new Error(String(response.status));
      onConnection("connected");
      wait = 1000;
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let buffer = "";
      for (;;) {
        heard();
        const { value, done } = await reader.read();
        if (done) break;
        buffer += value;
        const parts = buffer.split("\n\n");
        buffer = parts.pop();
        for (const part of parts) {
          const message = parseMessage(part);
          if (message.id) last = message.id;
          if (message.data) onMessage(message.event, JSON.parse(message.data));
        }
      }
    } catch (error) {
      console.info("stream:", error.message);
    }
    clearTimeout(timer);
    onConnection(state);
    await new Promise((resolve) => {
      wake = resolve;
      setTimeout(resolve, wait);
    });
  }
}
