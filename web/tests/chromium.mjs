// Headless Chromium for tests, and a server of this folder's files.

import { execFileSync } from "node:child_process";
import { createReadStream, readFileSync, statSync } from "node:fs";
import { createServer } from "node:http";
import { createRequire } from "node:module";
import path from "node:path";
import { fileURLToPath } from "node:url";

export const web = path.dirname(path.dirname(fileURLToPath(import.meta.url)));

const TYPES = {
    ".css": "text/css", ".html": "text/html", ".js": "text/javascript", ".mjs": "text/javascript", ".wasm": "application/wasm",
};
/** What isolates a page, so that it may share memory. */
const ISOLATES = { "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Embedder-Policy": "require-corp" };

/** The policy of the page, which workers have from their own responses. */
const POLICY = /http-equiv="Content-Security-Policy" content="([^"]*)"/.exec(readFileSync(path.join(web, "page/index.html"), "utf8"))[1];

/** An empty page is at /blank.html. */
const server = (isolates) => createServer((request, response) => {
    if (isolates) for (const [name, value] of Object.entries(ISOLATES)) response.setHeader(name, value);
    const asked = decodeURIComponent(new URL(request.url, "http://127.0.0.1").pathname);
    if (asked.startsWith("/target/page/")) response.setHeader("Content-Security-Policy", POLICY);
    const file = path.join(web, asked.endsWith("/") ? `${asked}index.html` : asked);
    const found = file.startsWith(web + path.sep) && statSync(file, { throwIfNoEntry: false })?.isFile();
    if (asked === "/blank.html") return response.writeHead(200, { "Content-Type": "text/html" }).end('<!doctype html><title>blank</title><link rel="icon" href="data:,">');
    if (!found) return response.writeHead(404).end();
    response.writeHead(200, { "Content-Type": TYPES[path.extname(file)] ?? "application/octet-stream", "Cache-Control": "no-store" });
    createReadStream(file).pipe(response);
});

/** Serves the files, to isolated pages or others; gives the address and the end of it. */
export async function serve(isolates = false) {
    const own = server(isolates);
    await new Promise((ready) => own.listen(0, "127.0.0.1", ready));
    return { root: `http://127.0.0.1:${own.address().port}`, close: () => own.close() };
}

/** Starts the browser by the driver in the folder `tools`. */
export function launch(tools, more = []) {
    const { chromium } = createRequire(path.join(path.resolve(tools), "x.js"))("playwright-core");
    const program = execFileSync("sh", ["-c", "command -v chromium"], { encoding: "utf8" }).trim();
    const args = ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run", ...more];
    if (process.getuid?.() === 0) args.push("--no-sandbox");
    return chromium.launch({ executablePath: program, headless: true, args });
}

export async function step(name, work) {
    const since = performance.now();
    await work();
    console.log(`ok: ${name} (${((performance.now() - since) / 1000).toFixed(1)} s)`);
}
