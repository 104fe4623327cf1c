// Talks to the station: requests with the token, if one is needed, and the event stream with resume.
let token = sessionStorage.getItem("token") || "";
let asking = null;

function headers(extra) {
  return token ? { ...extra, Authorization: `Bearer ${token}` } : { ...extra };
}

function askForToken() {
  if (asking) return asking;
  const dialog = document.getElementById("login");
  asking = new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      token = document.getElementById("token").value.trim();
      sessionStorage.setItem("token", token);
      asking = null;
      resolve();
    }, { once: true });
    dialog.showModal();
  });
  return asking;
}

async function request(path, extra = {}) {
  for (;;) {
    const response = await fetch(path, { headers: headers(extra), cache: "no-cache" });
    if (response.status !== 401) return response;
    await askForToken();
  }
}

export async function getJson(path) {
  const response = await request(path);
  if (!response.ok) {
    const error = new Error(`${path}: ${response.status}`);
    error.status = response.status;
    throw error;
  }
  return response.json();
}

export async function getBlob(path) {
  const response = await request(path);
  return response.ok ? response.blob() : null;
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

// fetch rather than EventSource, which can send no token. Calls back with every message and with true or false as the
// connection comes and goes; tries again for ever.
export async function follow(onMessage, onConnection) {
  let last = "";
  for (let wait = 1000; ; wait = Math.min(wait * 2, 30000)) {
    try {
      const response = await request("/v1/stream", last ? { "Last-Event-ID": last } : {});
      if (!response.ok) throw new Error(String(response.status));
      onConnection(true);
      wait = 1000;
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let buffer = "";
      for (;;) {
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
    onConnection(false);
    await new Promise((resolve) => setTimeout(resolve, wait));
  }
}
