// Checks report pages in headless Chromium: three widths, both colour schemes, keyboard only, printed. Reports all findings, then
// fails if there are any. Arguments: pages. Environment: PAGE_MODULES (directory of node_modules), PAGE_SHOTS (screenshot
// directory), CHROMIUM (browser).
"use strict";
const path = require("node:path");
const { pathToFileURL } = require("node:url");
const { failed, inPage, launched, looksRight, opened, reported, wrong } = require("./browser.js");

const WIDTHS = [320, 768, 1440];
const SCHEMES = ["light", "dark"];

// Folded, the page is short, and the first screen has the parameters.
const MOST_SCREENS = 5;

async function isShort({ page, say }) {
  const [screens, button] = await page.evaluate(() => {
    const copy = document.querySelector("button[data-copy]");
    return [document.documentElement.scrollHeight / innerHeight, copy === null ? 0 : copy.getBoundingClientRect().bottom / innerHeight];
  });
  if (screens > MOST_SCREENS) say(`${screens.toFixed(1)} screens`);
  if (button > 1) say(`the parameters are ${button.toFixed(1)} screens down`);
}

const unfold = ({ page }, isOpen) =>
  page.evaluate((open) => document.querySelectorAll("details").forEach((part) => (part.open = open)), isOpen);

// Tab reaches all controls in page order with a visible focus.
async function keyboardReaches({ page, say }) {
  const all = await page.evaluate(() => window.usable());
  const reached = [];
  for (let i = 0; i < all; i++) {
    await page.keyboard.press("Tab");
    const { number, isSeen } = await page.evaluate(() => window.focused());
    reached.push(number);
    if (!isSeen) say(`focus on number ${number} is not seen`);
  }
  const missed = [...Array(all).keys()].filter((number) => !reached.includes(number));
  if (missed.length || reached.some((number, i) => number !== i)) say(`Tab reaches ${reached}, not ${missed}`);
  // The skip link jumps past the navigation.
  await page.reload();
  await page.keyboard.press("Tab");
  await page.keyboard.press("Enter");
  await page.waitForURL(/#verdict$/, { timeout: 10000 }).catch(() => say("the skip link leads nowhere"));
}

async function copies({ context, page, say }) {
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
  if (copied !== shown || shown === "") say(`copied ${copied.length} letters of ${shown.length}`);
  return true;
}

async function prints({ page, say }) {
  await page.emulateMedia({ media: "print", colorScheme: "light" });
  for (const what of await page.evaluate(() => window.printed())) say(what);
  const paper = await page.pdf({ format: "A4" });
  if (paper.length < 20000) say("prints nothing");
}

async function main(files) {
  const browser = await launched();
  let copied = 0;
  for (const file of files) {
    for (const width of WIDTHS) {
      for (const scheme of SCHEMES) {
        const where = `${path.basename(file)} at ${width} px, ${scheme}`;
        const look = await opened(browser, pathToFileURL(path.resolve(file)).href, { width, height: 900 }, scheme, where);
        await isShort(look);
        await unfold(look, true);
        await looksRight(look);
        await unfold(look, false);
        const shot = `${path.basename(file, ".html")}-${width}-${scheme}.png`;
        await look.page.screenshot({ path: path.join(process.env.PAGE_SHOTS, shot), fullPage: true });
        if (scheme === "light" && width !== 768) await keyboardReaches(look);
        if (scheme === "light") copied += await copies(look);
        await look.page.evaluate(inPage);
        if (scheme === "dark" && width === 1440) await prints(look);
        await look.context.close();
      }
    }
  }
  await browser.close();
  if (copied === 0) wrong.push("no page had anything to copy");
  reported(`${files.length} pages, ${WIDTHS.length} widths, ${SCHEMES.length} schemes: all right`);
}

main(process.argv.slice(2)).catch(failed);
