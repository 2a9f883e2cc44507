// Builds, and rays a second, by the number of threads, in turn and with answers compared. In headless Chromium by the driver in the folder TOOLS:
// node scripts/threads.mjs TOOLS [FILE.obj] [RAYS] [ROUNDS] [THREADS,...]
//
// 0 threads are the compiled part without threads. On a busy machine more threads get a larger share of it, so that times on the clock flatter them:
// the seconds of processor time beside them, of all threads together, do not.

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
    const processes = await browser.newBrowserCDPSession();
    /** Seconds of processor time of all pages so far. */
    const spent = async () => {
        const { processInfo } = await processes.send("SystemInfo.getProcessInfo");
        return processInfo.filter(({ type }) => type === "renderer").reduce((sum, { cpuTime }) => sum + cpuTime, 0);
    };
    const things = ["balanced", "best", "primary", "chords"];
    const times = numbers.map(() => Object.fromEntries(things.map((what) => [what, { took: [], cpu: [] }])));
    const answers = Object.fromEntries(things.map((what) => [what, new Set()]));
    for (let round = 0; round < Number(rounds); round += 1) {
        for (const what of things) {
            for (const place of numbers.keys()) {
                const before = await spent();
                const { took, answer } = await page.evaluate(([place, what]) => window.ask(window.workers[place], what), [place, what]);
                times[place][what].took.push(took);
                times[place][what].cpu.push(1000 * (await spent() - before));
                answers[what].add(answer);
            }
        }
    }
    const isEqual = Object.values(answers).every((all) => all.size === 1);
    console.log(`Chromium ${browser.version()}, ${cpus()[0].model}, ${cpus().length} cores, load ${loadavg().map((load) => load.toFixed(1)).join(", ")}`);
    console.log(`${file ?? "a sphere"}: ${told[0].triangles} triangles, digest ${told[0].digest}, ${count} rays, medians of ${rounds} rounds; ${isEqual ? "all answers equal" : "ANSWERS DIFFER"}`);
    for (const what of things) {
        for (const [place, threads] of numbers.entries()) {
            const [took, cpu] = ["took", "cpu"].map((kind) => median(times[place][what][kind]));
            const rate = what === "primary" || what === "chords" ? `, ${(Number(count) / took / 1000).toFixed(2)} million rays a second` : "";
            const who = threads === 0 ? "without threads" : `${threads} thread${threads === 1 ? "" : "s"}`;
            console.log(`${what}, ${who}: ${took.toFixed(0)} ms, ${cpu.toFixed(0)} ms of processor time${rate}`);
        }
    }
    if (!isEqual) process.exitCode = 1;
} finally {
    await browser.close();
    server.close();
}
