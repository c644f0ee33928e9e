// What the checks of pages share: the browser, and findings. Environment: PAGE_MODULES (directory of node_modules), CHROMIUM
// (browser).
"use strict";
const fs = require("node:fs");
const path = require("node:path");
const { createRequire } = require("node:module");

const installed = createRequire(path.join(process.env.PAGE_MODULES, "package.json"));
const { chromium } = installed("playwright-core");
const axe = fs.readFileSync(installed.resolve("axe-core/axe.min.js"), "utf8");
const inPage = fs.readFileSync(path.join(__dirname, "in-page.js"), "utf8");

const recordedFindings = [];

function launchBrowser(more = []) {
  const args = process.getuid() === 0 ? ["--no-sandbox", ...more] : more;
  return chromium.launch({ executablePath: process.env.CHROMIUM, args });
}

// Opens a page; its errors, and any request but its own, are findings.
async function openPage(browser, url, viewport, colorScheme, where) {
  const context = await browser.newContext({ viewport, colorScheme });
  const page = await context.newPage();
  const addFinding = (what) => recordedFindings.push(`${where}: ${what}`);
  page.on("console", (message) => ["error", "warning"].includes(message.type()) && addFinding(`console: ${message.text()}`));
  page.on("pageerror", (error) => addFinding(`script: ${error.message}`));
  page.on("request", (request) => request.url() !== url && !request.url().startsWith("blob:") && addFinding(`asks for ${request.url()}`));
  await page.goto(url);
  return { context, page, addFinding };
}

async function checkLayout({ page, addFinding }) {
  await page.evaluate(inPage);
  for (const what of await page.evaluate(() => window.layoutFindings())) addFinding(what);
  await page.evaluate(axe);
  const { violations } = await page.evaluate(() => window.axe.run(document));
  for (const { id, nodes } of violations) addFinding(`axe: ${id}: ${nodes.slice(0, 3).map((node) => node.target).join(", ")}`);
}

function reportFindings(text) {
  for (const what of recordedFindings) console.error(`page: ${what}`);
  if (recordedFindings.length) process.exit(1);
  console.log(`page: ${text}`);
}

function reportFailure(error) {
  recordedFindings.push(error.message);
  reportFindings("");
}

module.exports = { reportFailure, inPage, launchBrowser, checkLayout, openPage, reportFindings, recordedFindings };
