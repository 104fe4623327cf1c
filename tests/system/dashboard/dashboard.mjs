// Clicks through the dashboard with Debian's chromium: live update, stale notice, lost connection, night mode, phone
// width, keyboard, no console error, nothing loaded from elsewhere. Screenshots go to OUT.
//   npm install; node dashboard.mjs LAMPGLOW ARCHIVE OUT
import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { spawn } from "node:child_process";
import { mkdtempSync, mkdirSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { chromium } from "playwright-core";

const [lampglow, archive, out] = process.argv.slice(2);
const port = 18200 + (process.pid % 700);
const work = mkdtempSync(join(tmpdir(), "lampglow-dashboard-"));
mkdirSync(out, { recursive: true });
// A replayed night is old: its frames are stale by nature, which is what the stale notice is tested with.
// The second camera never gives a picture.
mkdirSync(join(work, "empty"));
const configure = (http) => writeFileSync(join(work, "station.toml"),
  `[station]\ndata_directory = "${work}/data"\nworkers = 1\n[http]\nport = ${port}\n${http}\n` +
  `[[cameras]]\nname = "night"\nsite_file = "${archive}/site.toml"\n[cameras.source]\nurl = "archive:${archive}"\n` +
  `[[cameras]]\nname = "empty"\nsite_file = "${archive}/site.toml"\n[cameras.source]\nurl = "watch:${work}/empty"\n`);
configure("");
const station = spawn(lampglow, ["serve", "--config", join(work, "station.toml")], { stdio: "inherit" });
const base = `http://127.0.0.1:${port}`;

async function until(what, condition, seconds = 180) {
  for (let i = 0; i < seconds * 5; ++i) {
    if (await condition().catch(() => false)) return;
    await new Promise((resolve) => setTimeout(resolve, 200));
  }
  throw new Error(`in ${seconds} s there was no ${what}`);
}

const browser = await chromium.launch({ executablePath: "/usr/bin/chromium", args: ["--no-sandbox"] });
let failed = true;
try {
  await until("frame", async () => (await fetch(`${base}/v1/current`)).ok);
  const page = await browser.newPage({ viewport: { width: 1280, height: 1400 } });
  const errors = [], elsewhere = [];
  page.on("console", (message) => { if (message.type() === "error") errors.push(message.text()); });
  page.on("pageerror", (error) => errors.push(error.message));
  page.on("request", (request) => { if (!request.url().startsWith(base) && !request.url().startsWith("blob:")) elsewhere.push(request.url()); });

  await page.goto(base);
  await until("time of a frame", async () => (await page.textContent("#time")) !== "–");
  await until("picture", async () => page.isVisible("#picture"));
  await until("series", async () => (await page.locator("#series canvas").count()) > 0);
  assert.match(await page.textContent("#notice"), /Stale/);
  for (const id of ["value", "band", "mean", "used", "metar"])
    assert.equal((await page.textContent(`#${id}`)).trim(), "–", `a stale page shows no ${id}`);

  const before = await page.textContent("#time");
  await until("live update", async () => (await page.textContent("#time")) !== before);

  // By keyboard alone: the first lamp's ring profile, miles, UTC, night.
  await page.locator("#lights button").first().focus();
  await page.keyboard.press("Enter");
  await until("ring profile", async () => page.isVisible("#profile-box"));
  await page.screenshot({ path: join(out, "desktop.png"), fullPage: true });
  // From frame to frame of the series, as soon as it has two.
  await until("way through the series by keys", async () => {
    await page.focus("#series");
    await page.keyboard.press("Home");
    const oldest = await page.textContent("#legend");
    assert.match(oldest, /^[0-9:]+: /);
    await page.keyboard.press("End");
    return (await page.textContent("#legend")) !== oldest;
  }, 60);
  for (const [id, expected] of [["unit", "mi"], ["zone", "UTC"]]) {
    await page.focus(`#${id}`);
    await page.keyboard.press("Enter");
    assert.equal(await page.textContent(`#${id}`), expected);
  }
  assert.match(await page.textContent("#time"), /UTC/);
  for (const theme of ["light", "dark", "night"]) {
    await page.focus("#theme");
    await page.keyboard.press("Enter");
    assert.equal(await page.getAttribute("html", "data-theme"), theme);
  }
  assert.equal(await page.evaluate(() => getComputedStyle(document.body).backgroundColor), "rgb(0, 0, 0)");
  await page.screenshot({ path: join(out, "night.png"), fullPage: true });
  await page.keyboard.press("Shift+Tab");
  assert.equal(await page.evaluate(() => document.activeElement.id), "zone", "focus moves in order");

  await page.setViewportSize({ width: 360, height: 740 });
  assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "no sideways scrolling on a phone");
  await page.screenshot({ path: join(out, "phone.png"), fullPage: true });

  assert.deepEqual(errors, [], "console errors");

  // Another camera: nothing of the first one's stands under its name.
  const nothing = async () => (await page.textContent("#time")) === "–" && (await page.textContent("#value")) === "–" &&
    /waiting/.test(await page.textContent("#weather")) && !(await page.isVisible("#picture")) &&
    (await page.textContent("#legend")) === "" && !/[0-9]/.test(await page.title());
  await page.selectOption("#camera", "empty");
  await until("empty page of a camera without pictures", nothing, 20);
  await page.selectOption("#camera", "night");
  await page.selectOption("#camera", "empty");
  await new Promise((resolve) => setTimeout(resolve, 3000));
  assert.ok(await nothing(), "what was asked for one camera came under another's name");
  await page.selectOption("#camera", "night");
  await until("picture again", async () => page.isVisible("#picture"), 20);
  assert.match(await page.textContent("#picture-time"), /20[0-9][0-9].*UTC/);
  // The browser itself tells of the 503 and 404 that say "no frame yet".
  assert.deepEqual(errors.filter((error) => !/status of (503|404)/.test(error)), [], "console errors");

  assert.deepEqual(elsewhere, [], "requests to elsewhere");

  // Pictures for those with a token alone, by a reload: who has none says so once, and sees the rest.
  configure(`protect = "pictures"\ntoken_hashes = ["${createHash("sha256").update("let me in").digest("hex")}"]`);
  station.kill("SIGHUP");
  await until("protection", async () => (await fetch(`${base}/v1/frames/latest.jpg`)).status === 401, 20);
  await page.reload();
  await until("words instead of the picture", async () => /need a token/.test(await page.textContent("#no-picture")), 20);
  assert.notEqual(await page.textContent("#time"), "–");
  assert.ok(!(await page.isVisible("#login")), "asks for what nobody wants");
  await page.click("#sign-in");
  await until("question for a token", async () => page.isVisible("#login"), 20);
  await page.keyboard.press("Escape");
  await new Promise((resolve) => setTimeout(resolve, 2000));
  assert.ok(!(await page.isVisible("#login")), "asks again and again");
  await page.click("#sign-in");
  await until("question for a token", async () => page.isVisible("#login"), 20);
  await page.fill("#token", "let me in");
  await page.keyboard.press("Enter");
  await until("picture for one with a token", async () => page.isVisible("#picture"), 20);

  // Everything: who says no to the question is told why there is nothing, and can change their mind.
  configure(`protect = "everything"\ntoken_hashes = ["${createHash("sha256").update("another").digest("hex")}"]`);
  station.kill("SIGHUP");
  await until("protection", async () => (await fetch(`${base}/v1/current`)).status === 401, 20);
  await page.reload();
  await until("question for a token", async () => page.isVisible("#login"), 40);
  await page.keyboard.press("Escape");
  await until("notice of the missing token", async () => /without a token/.test(await page.textContent("#notice")), 20);
  await page.click("#sign-in");
  await until("question for a token", async () => page.isVisible("#login"), 20);
  await page.fill("#token", "another");
  await page.keyboard.press("Enter");
  await until("page for one with a token", async () => (await page.textContent("#time")) !== "–" && page.isVisible("#picture"), 40);
  await until("no notice of it", async () => !/without a token/.test(await page.textContent("#notice")), 20);

  station.kill("SIGTERM");
  await until("notice of the lost connection", async () => /No connection/.test(await page.textContent("#notice")), 20);
  failed = false;
  console.log("dashboard: all well");
} finally {
  await browser.close();
  station.kill("SIGKILL");
  process.exitCode = failed ? 1 : 0;
}
