// Checks report pages in headless Chromium: four widths, dark colours, keyboard only, printed. Reports all findings, then fails if
// there are any. Arguments: pages. Environment: PAGE_MODULES (directory of node_modules), PAGE_SHOTS (screenshot
// directory), CHROMIUM (browser).
"use strict";
const path = require("node:path");
const { pathToFileURL } = require("node:url");
const { reportFailure, inPage, launchBrowser, checkLayout, openPage, reportFindings, recordedFindings } = require("./browser.js");

const WIDTHS = [320, 390, 820, 1280];
const HEIGHT = 844;
// The dark scheme changes colours alone (colours.css), which are the same at all widths.
const LOOKS = [...WIDTHS.map((width) => ({ width, scheme: "light" })), { width: 1280, scheme: "dark" }];

// Largest height of the page with folded parts, in screens; the first screen must show the button that copies the parameters.
const MAX_SCREENS = 5;
// Largest number of printed sheets of a page with three compasses.
const MAX_SHEETS = 6;

async function checkHeight({ page, addFinding }) {
  const [screens, button] = await page.evaluate(() => {
    const copy = document.querySelector("button[data-copy]");
    return [document.documentElement.scrollHeight / innerHeight, copy === null ? 0 : copy.getBoundingClientRect().bottom / innerHeight];
  });
  if (screens > MAX_SCREENS) addFinding(`${screens.toFixed(1)} screens`);
  if (button > 1) addFinding(`the parameters are ${button.toFixed(1)} screens down`);
}

const unfold = ({ page }, isOpen) =>
  page.evaluate((open) => document.querySelectorAll("details").forEach((part) => (part.open = open)), isOpen);

// Each chart is drawn in several colours; the pointer shows values; a dragged range is that of all charts over time, until the
// button shows the whole flight; the sphere turns by keys.
async function checkCharts({ page, addFinding }) {
  const charts = page.locator(".chart");
  for (let i = 0; i < (await charts.count()); i++) {
    const isDrawn = await charts.nth(i).evaluate((chart) => {
      const canvas = chart.querySelector("canvas");
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return new Set(new Uint32Array(data.buffer)).size > 20;
    });
    if (!isDrawn) addFinding(`chart ${i} is empty`);
  }
  const over = page.locator('[data-chart="errors"] .u-over').first();
  if ((await over.count()) === 0) return 0;
  await over.scrollIntoViewIfNeeded();
  const { x, y, width, height } = await over.boundingBox();
  await page.mouse.move(x + width / 4, y + height / 2);
  const legend = await page.locator('[data-chart="errors"] .u-value').first().textContent();
  if (!/^\d/.test(legend)) addFinding(`the pointer shows ${legend}`);
  const ranges = () => page.evaluate(() => [...document.querySelector(".range").querySelectorAll("input")].map((input) => input.valueAsNumber));
  const other = () => page.locator('[data-chart="strength"] canvas').first().evaluate((canvas) => canvas.toDataURL());
  const [[from, to], before] = [await ranges(), await other()];
  await page.mouse.down();
  await page.mouse.move(x + width / 2, y + height / 2, { steps: 4 });
  await page.mouse.up();
  await page.waitForTimeout(100);
  const [[zoomFrom, zoomTo], zoomed] = [await ranges(), await other()];
  const share = (zoomTo - zoomFrom) / (to - from);
  if (!(share > 0.2 && share < 0.3) || zoomed === before) addFinding(`dragging a quarter shows ${share}`);
  await page.locator(".range button").first().click();
  await page.mouse.move(0, 0);
  await page.waitForTimeout(100);
  const [wholeFrom, wholeTo] = await ranges();
  if (Math.abs(wholeFrom - from) + Math.abs(wholeTo - to) > 0.2) addFinding(`the whole flight is ${wholeFrom} to ${wholeTo}`);
  const sphere = page.locator('[data-chart="sphere"] canvas').first();
  const picture = () => sphere.evaluate((canvas) => canvas.toDataURL());
  const still = await picture();
  await sphere.focus();
  await page.keyboard.press("ArrowRight");
  if ((await picture()) === still) addFinding("the sphere does not turn");
  return 1;
}

// Tab reaches all controls in page order with a visible focus.
async function checkKeyboard({ page, addFinding }) {
  await page.reload();
  await page.evaluate(inPage);
  const all = await page.evaluate(() => window.usableControlCount());
  const reached = [];
  for (let i = 0; i < all; i++) {
    await page.keyboard.press("Tab");
    const { number, isSeen } = await page.evaluate(() => window.focusedControl());
    reached.push(number);
    if (!isSeen) addFinding(`focus on number ${number} is not seen`);
  }
  const missed = [...Array(all).keys()].filter((number) => !reached.includes(number));
  if (missed.length || reached.some((number, i) => number !== i)) addFinding(`Tab reaches ${reached}, not ${missed}`);
  // The skip link jumps past the navigation.
  await page.reload();
  await page.keyboard.press("Tab");
  await page.keyboard.press("Enter");
  await page.waitForURL(/#verdict$/, { timeout: 10000 }).catch(() => addFinding("the skip link leads nowhere"));
}

async function checkCopy({ context, page, addFinding }) {
  const button = page.locator("button[data-copy]");
  if ((await button.count()) === 0) return false;
  await context.grantPermissions(["clipboard-read", "clipboard-write"]);
  await button.focus();
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => document.getElementById("copied").textContent !== "");
  const [copied, shown] = await page.evaluate(async () => [
    await navigator.clipboard.readText(),
    document.getElementById("parameters-text").textContent,
  ]);
  if (copied !== shown || shown === "") addFinding(`copied ${copied.length} letters of ${shown.length}`);
  return true;
}

// Folded parts are printed, too, and folded again after it.
async function checkPrint({ page, addFinding }) {
  await page.emulateMedia({ media: "print", colorScheme: "light" });
  await page.evaluate(() => addEventListener("beforeprint", () => (window.unfolded = document.querySelectorAll("details:not(.terminal, .menu)[open]").length)));
  const parts = await page.locator("details:not(.terminal, .menu)").count();
  for (const what of await page.evaluate(() => window.printFindings())) addFinding(what);
  const paper = await page.pdf({ format: "A4" });
  const sheets = paper.toString("latin1").match(/\/Type\s*\/Page\b(?!s)/g).length;
  if (paper.length < 20000) addFinding("prints nothing");
  const [unfolded, left] = await page.evaluate(() => [window.unfolded, document.querySelectorAll("details[open]").length]);
  if (unfolded !== parts || left !== 0) addFinding(`prints ${unfolded} of ${parts} parts, leaves ${left} unfolded`);
  if (sheets > MAX_SHEETS) addFinding(`prints ${sheets} sheets`);
}

async function main(files) {
  const browser = await launchBrowser();
  let [copied, charted] = [0, 0];
  for (const file of files) {
    for (const { width, scheme } of LOOKS) {
      const where = `${path.basename(file)} at ${width} px, ${scheme}`;
      const look = await openPage(browser, pathToFileURL(path.resolve(file)).href, { width, height: HEIGHT }, scheme, where);
      const shot = (state) => `${path.basename(file, ".html")}-${width}-${scheme}-${state}.png`;
      await checkHeight(look);
      await unfold(look, true);
      await checkLayout(look);
      charted += await checkCharts(look);
      await look.page.screenshot({ path: path.join(process.env.PAGE_SHOTS, shot("unfolded")), fullPage: true });
      await unfold(look, false);
      await look.page.screenshot({ path: path.join(process.env.PAGE_SHOTS, shot("folded")), fullPage: true });
      if (scheme === "light" && width !== 820) await checkKeyboard(look);
      if (scheme === "light") copied += await checkCopy(look);
      await look.page.evaluate(inPage);
      if (scheme === "dark") {
        await unfold(look, false);
        await checkPrint(look);
      }
      await look.context.close();
    }
  }
  await browser.close();
  if (copied === 0) recordedFindings.push("no page had anything to copy");
  if (charted === 0) recordedFindings.push("no page had charts");
  reportFindings(`${files.length} pages, ${WIDTHS.length} widths, light and dark: all right`);
}

main(process.argv.slice(2)).catch(reportFailure);
