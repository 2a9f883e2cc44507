// Builds, and rays a second, by the number of threads, in turn and with answers compared. In headless Chromium by the driver in the folder TOOLS:
// node scripts/threads.mjs TOOLS [FILE.obj] [RAYS] [ROUNDS] [THREADS,...]
//
// 0 threads are the compiled part without threads.

import { readFileSync } from "node:fs";
import { cpus, loadavg } from "node:os";

import { launch, serve } from "../tests/chromium.mjs";

const [tools, file, count = "200000", rounds = "5", counts = "0,1,2"] = process.argv.slice(2);
if (tools === undefined) {
    console.error("threads.mjs: TOOLS is missing; scripts/web.sh setup --browser makes web/target/tools");
    process.exit(2);
}
const numbers = counts.split(",").map(Number);
const median = (times) => times.toSorted((a, b) => a - b)[times.length >> 1];

const server = await serve(true);
const browser = await launch(tools);
try {
    const page = await browser.newPage();
    page.setDefaultTimeout(600_000);
    await page.goto(`${server.root}/blank.html`);
    await page.evaluate(() => {
        window.ask = (worker, message) =>
            new Promise((resolve, reject) => {
                worker.onmessage = ({ data }) => (data.error ? reject(new Error(data.error)) : resolve(data));
                worker.onerror = ({ message }) => reject(new Error(message));
                worker.postMessage(message);
            });
    });
    const text = file === undefined ? null : readFileSync(file, "utf8");
    const told = [];
    for (const threads of numbers) {
        told.push(await page.evaluate(([threads, text, count]) => {
            const worker = new Worker("/scripts/threads-worker.mjs", { type: "module" });
            (window.workers ??= []).push(worker);
            return window.ask(worker, { threads, text, count });
        }, [threads, text, Number(count)]));
    }
    const times = numbers.map(() => ({}));
    const hashes = new Set(told.map(({ digest }) => digest));
    for (let round = 0; round < Number(rounds); round += 1) {
        for (const place of numbers.keys()) {
            const { answers, ...took } = await page.evaluate((place) => window.ask(window.workers[place], "round"), place);
            for (const [what, time] of Object.entries(took)) (times[place][what] ??= []).push(time);
            hashes.add(answers);
        }
    }
    console.log(`${browser.version()}, ${cpus()[0].model}, ${cpus().length} cores, load ${loadavg().map((load) => load.toFixed(1)).join(", ")}`);
    console.log(`${file ?? "a sphere"}: ${told[0].triangles} triangles, digest ${told[0].digest}, ${count} rays, ${rounds} rounds; ${hashes.size === 2 ? "all answers equal" : "ANSWERS DIFFER"}`);
    for (const [place, threads] of numbers.entries()) {
        const rates = ["primary", "chords"].map((set) => `${set} ${(Number(count) / median(times[place][set]) / 1000).toFixed(2)} million a second`);
        const builds = ["balanced", "best"].map((preset) => `${preset} ${median(times[place][preset]).toFixed(0)} ms`);
        console.log(`${threads === 0 ? "the part without threads" : `threads: ${threads}`}: builds ${builds.join(", ")}; ${rates.join(", ")}`);
    }
    if (hashes.size !== 2) process.exitCode = 1;
} finally {
    await browser.close();
    server.close();
}
