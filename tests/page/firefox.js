// Judges logs and flies the example aircraft on the page of scripts/build-web in headless Firefox, from file://: the figures are those
// of the command line. Arguments: the page, then logs. Environment: PAGE_MODULES (directory of node_modules), PAGE_SHOTS (screenshot
// directory), FIREFOX (browser), HOST_SIM (the command line).
"use strict";
const { spawnSync } = require("node:child_process");
const { createRequire } = require("node:module");
const path = require("node:path");
const { pathToFileURL } = require("node:url");

const puppeteer = createRequire(path.join(process.env.PAGE_MODULES, "package.json"))("puppeteer-core");
const WAIT = { timeout: 300000 };
const recordedFindings = [];

function byCommand(...words) {
  const { stdout, status, stderr } = spawnSync(process.env.HOST_SIM, [...words, "--json"]);
  if (status > 1) throw new Error(`host-sim: ${stderr}`);
  return stdout.toString();
}

// Calls `start`, waits until the page's progress bar is hidden, and compares the page's figures with `expected`.
async function compare(page, what, start, expected) {
  const began = performance.now();
  await start();
  await page.waitForFunction(() => document.querySelector("progress").hidden, WAIT);
  const seconds = ((performance.now() - began) / 1e3).toFixed(1);
  // `judged` is the variable of page.js with the last judgement.
  const json = await page.evaluate("judged === null || judged === undefined ? null : judged.json");
  if (`${json}\n` !== expected) recordedFindings.push(`${what}: ${await page.$eval("#error", (status) => status.textContent)}: ${json} is not ${expected}`);
  if ((await page.$("#verdict")) === null) recordedFindings.push(`${what}: no report`);
  console.log(`Firefox: ${what}: ${seconds} s`);
}

async function main([file, ...logs]) {
  const browser = await puppeteer.launch({ browser: "firefox", executablePath: process.env.FIREFOX, headless: true });
  try {
    const page = await browser.newPage();
    page.on("console", (message) => ["error", "warn"].includes(message.type()) && recordedFindings.push(`console: ${message.text()}`));
    page.on("pageerror", (error) => recordedFindings.push(`script: ${error.message}`));
    await page.setViewport({ width: 1280, height: 900 });
    await page.goto(pathToFileURL(path.resolve(file)).href);
    for (const log of logs) {
      const choose = async () => (await page.$("#file")).uploadFile(path.resolve(log));
      await compare(page, path.basename(log), choose, byCommand("replay", log));
    }
    await compare(page, "example flight", () => page.click("#fly"), byCommand("fly", "--seed", "1"));
    const corrected = await page.$$eval("#circles .corrected", (points) => points.length);
    if (corrected < 50) recordedFindings.push(`${corrected} corrected points are drawn`);
    await page.screenshot({ path: path.join(process.env.PAGE_SHOTS, "firefox.png"), fullPage: true });
    console.log(await browser.version());
  } finally {
    await browser.close();
  }
}

main(process.argv.slice(2))
  .catch((error) => recordedFindings.push(error.message))
  .finally(() => {
    for (const what of recordedFindings) console.error(`page: ${what}`);
    process.exitCode = recordedFindings.length ? 1 : 0;
  });
