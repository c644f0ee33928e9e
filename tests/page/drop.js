// Judges logs on the page of scripts/build-web in headless Chromium, and flies the example aircraft there: the figures and parameters
// are those of the command line, byte for byte; no connection is tried; what cannot be judged is refused in words. Arguments: the page, then logs. Environment:
// as browser.js, and PAGE_SHOTS (screenshot directory), HOST_SIM (the command line).
"use strict";
const { spawnSync } = require("node:child_process");
const fs = require("node:fs");
const http = require("node:http");
const net = require("node:net");
const os = require("node:os");
const path = require("node:path");
const { pathToFileURL } = require("node:url");
const { reportFailure, inPage, launchBrowser, checkLayout, openPage, reportFindings, recordedFindings } = require("./browser.js");

const WIDE = { width: 1440, height: 900 };
const PHONE = { width: 320, height: 700 };
const WAIT = { timeout: 300000 };
// Size of a file larger than any log; the page must read it in pieces, because it does not fit into memory.
const HUGE_BYTES = 500e6;
// Longest task of the page while it judges and shows a log, milliseconds. An idle computer takes 80, a busy one was seen to take 280;
// work of the worker on the page's own thread takes seconds.
const MAX_TASK_MS = 1000;
// Chromium's own requests (updates, account), which are not the page's.
const OF_THE_BROWSER = /^(CONNECT |POST http:\/\/)[a-z.-]+\.google(apis)?\.com[:/]/;

// The page's content security policy, compared literally, because a missing part would change nothing visible.
const POLICY = [
  "default-src 'none'", "script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:", "worker-src blob:", "style-src 'unsafe-inline'",
  "img-src data: blob:", "connect-src 'none'", "form-action 'none'", "base-uri 'none'",
].join("; ");

const work = fs.mkdtempSync(path.join(os.tmpdir(), "page-"));
process.on("exit", () => fs.rmSync(work, { recursive: true }));

function judgeByCommand(log, ...options) {
  const parameters = path.join(work, "command.param");
  fs.rmSync(parameters, { force: true });
  const { stdout, status, stderr } = spawnSync(process.env.HOST_SIM, ["replay", log, "--json", "--params", parameters, ...options]);
  if (status > 1) throw new Error(`host-sim: ${stderr}`);
  return { json: stdout.toString(), parameters: fs.existsSync(parameters) ? fs.readFileSync(parameters, "utf8") : null };
}

const untilJudged = (page) => page.waitForFunction(() => document.querySelector("progress").hidden, null, WAIT);

async function downloadedText(page, selector) {
  await page.evaluate(() => (document.querySelector("#again").open = true));
  const control = page.locator(selector).first();
  if (!(await control.isVisible())) return null;
  const [download] = await Promise.all([page.waitForEvent("download"), control.click()]);
  return fs.readFileSync(await download.path(), "utf8");
}

async function compareWithCommand({ page, addFinding }, expected, what) {
  const json = await downloadedText(page, "#save-json");
  if (json !== expected.json) addFinding(`${what}: figures differ: ${json} is not ${expected.json}`);
  if ((await downloadedText(page, "#report a.button")) !== expected.parameters) addFinding(`${what}: parameters differ`);
}

// Drops files by the events of a mouse; the page's file dialog is used otherwise.
async function drop(page, ...logs) {
  const files = logs.map((log) => [path.basename(log), fs.readFileSync(log).toString("base64")]);
  const transfer = await page.evaluateHandle((files) => {
    const transfer = new DataTransfer();
    for (const [name, base64] of files) transfer.items.add(new File([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))], name));
    return transfer;
  }, files);
  await page.waitForTimeout(100);
  await page.evaluate((transfer) => {
    window.longest = 0;
    for (const type of ["dragover", "drop"]) {
      document.body.dispatchEvent(new DragEvent(type, { dataTransfer: transfer, bubbles: true, cancelable: true }));
    }
  }, transfer);
}

// Flies the example aircraft: its figures are those of `host-sim fly`, its pictures grow, and its report follows.
async function checkExampleFlight(look, seed, shot) {
  const { page, addFinding } = look;
  const expected = spawnSync(process.env.HOST_SIM, ["fly", "--json", "--seed", `${seed}`]).stdout.toString();
  await page.evaluate(() => (scrollTo(0, 0), (window.longest = 0)));
  await page.evaluate(() => (document.querySelector("#examples details").open = true));
  await page.fill("#seed", `${seed}`);
  const start = performance.now();
  await page.click("#fly");
  await page.waitForFunction(() => document.querySelectorAll("#circles .measured").length > 50, null, WAIT);
  const measured = () => page.locator("#circles .measured").count();
  const covered = () => page.locator("#circles .covered").count();
  const early = [await measured(), await covered()];
  const isInView = await page.evaluate(() => ["circles", "errors"].every((id) => document.getElementById(id).getBoundingClientRect().bottom <= innerHeight));
  if (!isInView) addFinding("the pictures of the flight are not in view");
  await untilJudged(page);
  const seconds = (performance.now() - start) / 1e3;
  const late = [await measured(), await covered()];
  if ((await chosenFileName(page)) !== "none") addFinding(`the example flight has the name of ${await chosenFileName(page)}`);
  if (late[0] <= early[0] || late[1] <= early[1]) addFinding(`the pictures do not grow: ${early} to ${late}`);
  if ((await page.locator("#circles .corrected").count()) < 50) addFinding("no circle is corrected");
  const json = await downloadedText(page, "#save-json");
  if (json !== expected) addFinding(`seed ${seed}: figures differ: ${json} is not ${expected}`);
  if (!(await page.locator("#verdict").isVisible())) addFinding("no report of the flight");
  const longest_ms = await page.evaluate(() => window.longest);
  if (longest_ms > MAX_TASK_MS) addFinding(`the flight: does not answer for ${longest_ms} ms`);
  await checkLayout(look);
  await shot(look, `flight-${seed}`);
  console.log(`example flight: ${seconds.toFixed(1)} s, ${late[0]} steps, longest task ${longest_ms.toFixed(0)} ms`);
}

const choose = (page, log) => page.setInputFiles("#file", log);
const chosenFileName = (page) => page.evaluate(() => document.querySelector("#file").files[0]?.name ?? "none");

// Judges a log and compares it with the command line. Returns the seconds, and the longest task of the page in milliseconds.
async function judge(look, log, give) {
  const { page, addFinding } = look;
  await page.evaluate(() => (window.longest = 0));
  const start = performance.now();
  await give(page, log);
  await untilJudged(page);
  const seconds = (performance.now() - start) / 1e3;
  if (!(await page.locator("#verdict").isVisible())) addFinding(`${log}: ${await page.locator("#status").textContent()}`);
  if ((await chosenFileName(page)) !== path.basename(log)) addFinding(`${log}: the file dialog names ${await chosenFileName(page)}`);
  const isInView = await page.evaluate(() => document.querySelector("#verdict").getBoundingClientRect().bottom <= innerHeight);
  if (!isInView) addFinding(`${log}: the verdict is not in view`);
  await compareWithCommand(look, judgeByCommand(log), log);
  const longest_ms = await page.evaluate(() => window.longest);
  if (longest_ms > MAX_TASK_MS) addFinding(`${log}: does not answer for ${longest_ms} ms`);
  return { seconds, longest_ms };
}

// Options chosen in the form give the same judgement as the command's options.
async function checkOptions(look, log) {
  const { page } = look;
  const compass = await page.locator("select[name=compass] option").nth(1).textContent();
  const from = Math.ceil(Number(await page.locator("input[name=from_s]").getAttribute("placeholder"))) + 20;
  await page.evaluate(() => (document.querySelector("#again").open = true));
  await page.selectOption("select[name=compass]", compass);
  await page.selectOption("select[name=module]", "all");
  await page.fill("input[name=from_s]", `${from}`);
  const isTable = await page.locator("select[name=unit]").isVisible();
  if (isTable) await page.selectOption("select[name=unit]", "ut");
  const reference = isTable ? "column" : "autopilot";
  await page.selectOption("select[name=reference]", reference);
  await page.focus("input[name=from_s]");
  const before = await page.locator("#report section").first().elementHandle();
  await page.keyboard.press("Enter");
  await page.waitForFunction((element) => !element.isConnected, before, WAIT);
  await untilJudged(page);
  const options = ["--compass", compass, "--module=all", "--from", `${from}`, "--reference", reference, ...(isTable ? ["--unit", "ut"] : [])];
  await compareWithCommand(look, judgeByCommand(log, ...options), `${log} with choices`);
}

// An archive of files that are not compressed.
function archive(...files) {
  const parts = files.map((file) => {
    const [name, content] = [Buffer.from(path.basename(file)), fs.readFileSync(file)];
    const header = Buffer.alloc(30);
    header.write("PK\u0003\u0004", "latin1");
    header.writeUInt32LE(content.length, 18);
    header.writeUInt32LE(content.length, 22);
    header.writeUInt16LE(name.length, 26);
    return Buffer.concat([header, name, content]);
  });
  return Buffer.concat([...parts, Buffer.from("PK\u0001\u0002", "latin1")]);
}

// What the command line writes to the error output, with the bare name of the log as on the page.
function refusalOfCommand(log, ...options) {
  const { status, stderr } = spawnSync(process.env.HOST_SIM, ["replay", log, ...options]);
  if (status !== 2) throw new Error(`host-sim judges ${log} ${options}`);
  return stderr.toString().trim().replace(/^[^ ]*: /, "").replaceAll(log, path.basename(log));
}

// What cannot be judged is refused by the same sentence as on the command line, in place of the result before it.
async function checkRefusals({ page, addFinding }, log) {
  const table = path.resolve("host-sim/data/flight.csv");
  const written = (name, content) => (fs.writeFileSync(path.join(work, name), content), path.join(work, name));
  const huge = written("huge.csv", "t_s,mx,my,mz,roll_deg,pitch_deg\n");
  fs.truncateSync(huge, HUGE_BYTES);
  const letter = written("letter.txt", "Dear reader\n");
  const copy = written("copy.csv", fs.readFileSync(table));
  const files = [
    letter, huge, written("empty.bin", ""), written("picture.png", "\u0089PNG\r\n\u001a\n"),
    written("none.zip", archive(letter)),
  ];
  const shown = async (what, expected) => {
    await untilJudged(page);
    const error = page.locator("#error");
    const text = (await error.isVisible()) ? await error.textContent() : "nothing";
    if (text !== expected) addFinding(`of ${what} it says: ${text}, in place of: ${expected}`);
    if ((await page.locator("#report section").count()) > 0) addFinding(`${what}: the result before it is left`);
  };
  for (const file of files) {
    await choose(page, file);
    await shown(file, refusalOfCommand(file));
    if (await page.locator("#again").isVisible()) addFinding(`offers choices of ${file}`);
  }
  // The page judges one log at a time, where the program gives a line for each.
  await choose(page, written("two.zip", archive(table, copy)));
  await shown("an archive of two", "several-logs: two.zip: these are several logs, of which one is judged at a time: flight.csv, copy.csv");
  await page.getByRole("button", { name: "copy.csv" }).click();
  await untilJudged(page);
  await compareWithCommand({ page, addFinding }, judgeByCommand(path.join(work, "two.zip", "copy.csv")), "the chosen log of two");
  await drop(page, table, copy);
  await shown("two files", "several-logs: flight.csv, copy.csv: these are several logs, of which one is judged at a time: flight.csv, copy.csv");
  await page.getByRole("button", { name: "flight.csv" }).click();
  await untilJudged(page);
  if ((await page.locator("#error").isVisible()) || !(await page.locator("#verdict").isVisible())) addFinding("the chosen file of two is not judged");
  for (const [from, to] of [[500, 200], [5000, 6000], [60, 61]]) {
    await choose(page, log);
    await untilJudged(page);
    await page.evaluate(() => (document.querySelector("#again").open = true));
    await page.fill("input[name=from_s]", `${from}`);
    await page.fill("input[name=to_s]", `${to}`);
    await page.focus("input[name=to_s]");
    await page.keyboard.press("Enter");
    await page.waitForFunction(() => document.querySelector("#report").childElementCount === 0, null, WAIT);
    await shown(`${from} to ${to} s`, refusalOfCommand(log, "--from", `${from}`, "--to", `${to}`));
  }
}

// A range that is dragged on a chart is judged by a button next to it.
async function checkDraggedPart(look, log) {
  const { page, addFinding } = look;
  await drop(page, log);
  await untilJudged(page);
  await page.evaluate(() => (document.querySelector("#charts").closest("details").open = true));
  const over = page.locator('[data-chart="errors"] .u-over').first();
  await over.scrollIntoViewIfNeeded();
  const { x, y, width, height } = await over.boundingBox();
  await page.mouse.move(x + 2, y + height / 2);
  await page.mouse.down();
  await page.mouse.move(x + width / 2, y + height / 2, { steps: 4 });
  await page.mouse.up();
  const before = await page.locator("#report section").first().elementHandle();
  await page.getByRole("button", { name: "Judge this part" }).first().click();
  await page.waitForFunction((element) => !element.isConnected, before, WAIT);
  await untilJudged(page);
  const [from, to] = await Promise.all(["from_s", "to_s"].map((name) => page.inputValue(`input[name=${name}]`)));
  if (!(Number(to) > Number(from))) addFinding(`the part is ${from} to ${to}`);
  await compareWithCommand(look, judgeByCommand(log, "--from", from, "--to", to), `${log} from ${from} to ${to} s`);
}

// The example log is the one that `fly --record` writes.
async function checkExampleLog(look) {
  const log = path.join(work, "example.bin");
  spawnSync(process.env.HOST_SIM, ["fly", "--json", "--record", log]);
  await look.page.click("#example-log");
  await untilJudged(look.page);
  await compareWithCommand(look, judgeByCommand(log), "the example log");
}

// Each control is reached by Tab, in the order of the page, with a visible focus.
async function checkKeyboard({ page, addFinding }) {
  await page.evaluate(inPage);
  const all = await page.evaluate(() => window.usableControlCount());
  const reached = [];
  // Tab proceeds from the control clicked last to the page's end, then from its start; the page itself has number -1.
  for (let i = 0; i <= all; i++) {
    await page.keyboard.press("Tab");
    const { number, isSeen } = await page.evaluate(() => window.focusedControl());
    reached.push(number);
    if (!isSeen && number >= 0) addFinding(`focus on number ${number} is not seen`);
  }
  const inOrder = reached.every((number, i) => i === 0 || number === reached[i - 1] + 1 || number === -1);
  if (new Set(reached).size !== all + 1 || !inOrder) addFinding(`Tab reaches ${reached} of ${all}`);
}

const withoutPolicy = (source) => source.replace(/<meta http-equiv="Content-Security-Policy"[^>]*>/, "");

// Checks these tests: requests that are added to the page or to its worker are detected; the page's policy blocks them, and without
// it they are sent.
async function checkRequestDetection(browser, file, connections) {
  const text = fs.readFileSync(file, "utf8");
  const ask = 'fetch("http://192.0.2.1/").catch(() => 0);\n';
  const bare = withoutPolicy(text);
  const fromPage = (source) => source.replace("startWorker();\n</script>", `startWorker();\n${ask}</script>`);
  const fromWorker = (source) => source.replace("let loading;\n", `let loading;\n${ask}`);
  const changed = { keptPage: fromPage(text), keptWorker: fromWorker(text), openPage: fromPage(bare), openWorker: fromWorker(bare) };
  for (const [name, source] of Object.entries(changed)) {
    const copy = path.join(work, `${name}.html`);
    fs.writeFileSync(copy, source);
    const [findings, tried] = [recordedFindings.length, connections()];
    const { page, context } = await openPage(browser, pathToFileURL(copy).href, WIDE, "light", name);
    await page.waitForTimeout(1000);
    await context.close();
    const [isNoticed, isSent] = [recordedFindings.length > findings, connections() > tried];
    recordedFindings.splice(findings);
    if (name.endsWith("Page") && !isNoticed) recordedFindings.push(`a request of ${name} was not noticed`);
    if (isSent !== name.startsWith("open")) recordedFindings.push(`a request of ${name} was ${isSent ? "sent" : "not sent"}`);
  }
}

function listenForPort(server) {
  return new Promise((resolve) => server.listen(0, "127.0.0.1", () => resolve(server.address().port)));
}

async function main([file, ...logs]) {
  // A proxy counts all connections to other computers, except the browser's own requests.
  let connections = 0;
  const counted = (request) => OF_THE_BROWSER.test(request) || connections++;
  const proxy = net.createServer((socket) => {
    socket.once("data", (request) => (counted(request), socket.destroy())).on("error", () => socket.destroy());
  });
  const browser = await launchBrowser([`--proxy-server=127.0.0.1:${await listenForPort(proxy)}`]);
  // The page is served without its policy, which would block a worker's requests, so that the proxy can count them.
  const bare = withoutPolicy(fs.readFileSync(file, "utf8"));
  const server = http.createServer((_, answer) => answer.setHeader("content-type", "text/html").end(bare));
  const served = `http://127.0.0.1:${await listenForPort(server)}/`;
  const start = async (url, viewport, scheme) => {
    const look = await openPage(browser, url, viewport, scheme, `${path.basename(file)} at ${viewport.width} px, ${scheme}`);
    await look.page.evaluate(() => {
      window.longest = 0;
      const noted = (list) => list.getEntries().forEach(({ duration }) => (window.longest = Math.max(window.longest, duration)));
      new PerformanceObserver(noted).observe({ type: "longtask" });
    });
    return look;
  };
  const shot = (look, name) => look.page.screenshot({ path: path.join(process.env.PAGE_SHOTS, `drop-${name}.png`), fullPage: true });

  const look = await start(pathToFileURL(path.resolve(file)).href, WIDE, "light");
  const policy = await look.page.locator("meta[http-equiv=Content-Security-Policy]").getAttribute("content");
  if (policy !== POLICY) look.addFinding(`its policy is ${policy}`);
  await checkLayout(look);
  await shot(look, "empty");
  await checkExampleLog(look);
  for (const [i, log] of logs.entries()) {
    const { seconds, longest_ms } = await judge(look, log, i % 2 ? drop : choose);
    console.log(`${path.basename(log)}: ${seconds.toFixed(1)} s, longest task ${longest_ms.toFixed(0)} ms`);
  }
  await checkLayout(look);
  await checkKeyboard(look);
  await shot(look, "wide");
  await checkOptions(look, logs.at(-1));
  await checkDraggedPart(look, logs[0]);
  await checkRefusals(look, logs[0]);
  await checkExampleFlight(look, 1, shot);
  await look.context.close();

  const phone = await start(served, PHONE, "dark");
  await judge(phone, logs[0], drop);
  await checkLayout(phone);
  await shot(phone, "phone");
  await checkOptions(phone, logs[0]);
  await checkExampleFlight(phone, 7, shot);
  await phone.context.close();

  if (connections > 0) recordedFindings.push(`${connections} connections were tried`);
  await checkRequestDetection(browser, file, () => connections);
  await browser.close();
  server.close();
  proxy.close();
  reportFindings(`${logs.length} logs judged on the page as by the command line, and the example flown`);
}

main(process.argv.slice(2)).catch(reportFailure);
