// Rays a second on one thread: this package, three-mesh-bvh, and the native library with its portable instruction set, on the same rays
// in turn, with answers compared. In Node, or with --chromium in headless Chromium by the driver in the folder TOOLS:
// node scripts/speed.mjs [--chromium TOOLS] [FILE.obj] [RAYS] [ROUNDS]
//
// On Linux times are those of the CPU, which other work disturbs less than the clock on the wall; builds are timed by the latter.
//
// The native program is target/release/splitplane above, or SPLITPLANE_PROGRAM; where it is not built (cargo build --release) it is left out.

import { execFileSync } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { cpus, loadavg, tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

import { Numbers, sphere } from "../tests/meshes.mjs";
import { Bench, WAYS, raySets, readObj } from "./rates.mjs";

const given = process.argv.slice(2);
const tools = given[0] === "--chromium" ? given.splice(0, 2)[1] : null;
const [named, count = "200000", rounds = "5"] = given;
const file = named || undefined;
const program = process.env.SPLITPLANE_PROGRAM ?? fileURLToPath(new URL("../../target/release/splitplane", import.meta.url));
const mesh = file === undefined ? sphere(150) : readObj(readFileSync(file, "utf8"));
const { positions, indices } = mesh;
const sets = raySets(positions, Number(count), new Numbers(3));
const median = (times) => times.toSorted((a, b) => a - b)[times.length >> 1];

/** Milliseconds of CPU that a process has had so far, in all its threads; `null` where the system does not tell. */
function cpuTime(pid) {
    const threads = `/proc/${pid}/task`;
    if (!existsSync(`${threads}/${pid}/schedstat`)) return null;
    const ofThread = (thread) => Number(readFileSync(`${threads}/${thread}/schedstat`, "utf8").split(" ")[0]);
    return readdirSync(threads).reduce((sum, thread) => sum + ofThread(thread), 0) / 1e6;
}

/** The bench in this process. */
async function here() {
    const [api, three, theirs] = await Promise.all([import("../js/node.js"), import("three"), import("three-mesh-bvh")]);
    await api.init();
    const bench = new Bench(api, three, theirs, mesh);
    const { digest } = bench.tree;
    return {
        where: `Node ${process.version}`, builds: bench.builds, digest, instructionSet: api.about().instructionSet,
        take: (name) => bench.take(sets[name]),
        pid: process.pid,
        run: (way) => bench.run(way),
        answers: () => ({ differ: bench.differ(), hits: Buffer.from(bench.into.bytes) }),
        end() {},
    };
}

/** The bench in a page. */
async function inChromium() {
    const { launch, serve } = await import("../tests/chromium.mjs");
    const server = await serve();
    const browser = await launch(tools);
    const session = await browser.newBrowserCDPSession();
    const renderers = async () => (await session.send("SystemInfo.getProcessInfo")).processInfo.filter(({ type }) => type === "renderer").map(({ id }) => id);
    const page = await browser.newPage();
    page.setDefaultTimeout(600_000);
    await page.goto(`${server.root}/blank.html`);
    await page.addScriptTag({
        type: "importmap",
        content: JSON.stringify({ imports: { three: "/node_modules/three/build/three.module.js", "three-mesh-bvh": "/node_modules/three-mesh-bvh/build/index.module.js" } }),
    });
    // Both make the same rays of the same mesh: whole numbers in, and single operations.
    const told = await page.evaluate(async ([text, count]) => {
        const [api, three, theirs, { Bench, raySets, readObj }, { Numbers, sphere }] = await Promise.all(
            ["/js/index.js", "three", "three-mesh-bvh", "/scripts/rates.mjs", "/tests/meshes.mjs"].map((name) => import(name)));
        await api.init();
        const mesh = text === null ? sphere(150) : readObj(text);
        window.sets = raySets(mesh.positions, count, new Numbers(3));
        window.bench = new Bench(api, three, theirs, mesh);
        return { builds: bench.builds, digest: bench.tree.digest, instructionSet: api.about().instructionSet };
    }, [file === undefined ? null : readFileSync(file, "utf8"), Number(count)]);
    // That of the page has worked most.
    const [pid] = (await renderers()).toSorted((a, b) => (cpuTime(b) ?? 0) - (cpuTime(a) ?? 0));
    return {
        where: `Chromium ${browser.version()}`, ...told, pid,
        take: (name) => page.evaluate((name) => bench.take(sets[name]), name),
        run: (way) => page.evaluate((way) => bench.run(way), way),
        async answers() {
            const [differ, hits] = await page.evaluate(() => [bench.differ(), Array.from(bench.into.words)]);
            return { differ, hits: Buffer.from(Uint32Array.from(hits).buffer) };
        },
        async end() {
            await browser.close();
            server.close();
        },
    };
}

const bench = await (tools === null ? here() : inChromium());
const load = () => `load ${loadavg()[0].toFixed(1)}`;
console.log(`${file ?? "a sphere"}: ${indices.length / 3} triangles, ${count} rays, median of ${rounds} rounds; ${bench.where}, ${bench.instructionSet}; ${cpus()[0].model}, ${load()}`);
console.log(`build: splitplane ${bench.builds[0].toFixed(0)} ms, three-mesh-bvh (SAH) ${bench.builds[1].toFixed(0)} ms; digest ${bench.digest}`);

const folder = mkdtempSync(path.join(tmpdir(), "splitplane-"));

/** Milliseconds of a batch by the native program: of some batches more, what they take more. */
function ofNative(rayFile) {
    const some = 8;
    const run = (repeat) => {
        const ask = ["query", path.join(folder, "mesh.obj"), "--backend", "cpu", "--preset", "balanced", "--rays", rayFile, "--repeat", String(repeat), "--threads", "1", "--json", "--hits", path.join(folder, "hits.raw")];
        const timed = 'TIMEFORMAT="%3U %3S"; { time "$@" 2>/dev/null; } 2>&1';
        const told = execFileSync("bash", ["-c", timed, "bash", program, ...ask], { env: { ...process.env, SPLITPLANE_ISA: "portable" }, encoding: "utf8", stdio: ["ignore", "pipe", "ignore"] });
        const lines = told.trim().split("\n");
        const [user, system] = lines.pop().split(" ").map(Number);
        return { cpu: 1000 * (user + system), onWall: JSON.parse(lines.join("\n")).trace_ms };
    };
    const [one, more] = [run(1), run(1 + some)];
    return cpuTime(process.pid) === null ? more.onWall : (more.cpu - one.cpu) / some;
}
try {
    const hasNative = existsSync(program);
    if (hasNative) {
        const rows = (array, head, add) =>
            Array.from({ length: array.length / 3 }, (_, i) => `${head} ${[0, 1, 2].map((k) => array[3 * i + k] + add).join(" ")}\n`).join("");
        writeFileSync(path.join(folder, "mesh.obj"), rows(positions, "v", 0) + rows(indices, "f", 1));
    } else console.log(`native: left out, there is no ${program}`);
    for (const [name, rays] of Object.entries(sets)) {
        await bench.take(name);
        const total = rays.length / 8;
        const times = {};
        const native = [];
        const rayFile = path.join(folder, `${name}.f32`);
        // Files of rays have both limits at the end.
        const inFile = rays.map((_, i) => rays[i - (i % 8) + [0, 1, 2, 4, 5, 6, 3, 7][i % 8]]);
        if (hasNative) writeFileSync(rayFile, Buffer.from(inFile.buffer));
        for (let round = 0; round < Number(rounds); round += 1) {
            for (const way of WAYS) {
                const since = cpuTime(bench.pid);
                const onWall = await bench.run(way);
                (times[way] ??= []).push(since === null ? onWall : cpuTime(bench.pid) - since);
            }
            if (hasNative) native.push(ofNative(rayFile));
        }
        const { differ, hits } = await bench.answers();
        const rate = (time) => total / time / 1000;
        const batch = median(times["splitplane, a batch"]);
        console.log(`${name}:`);
        for (const [way, all] of Object.entries(times)) console.log(`  ${way}: ${rate(median(all)).toFixed(3)} million rays/s`);
        console.log(`  a batch over three-mesh-bvh: ${(median(times["three-mesh-bvh, ray by ray"]) / batch).toFixed(2)}; rays that differ: ${differ} of ${total}; ${load()}`);
        if (hasNative) {
            const equal = Buffer.compare(readFileSync(path.join(folder, "hits.raw")), hits) === 0;
            console.log(`  native, portable: ${rate(median(native)).toFixed(3)} million rays/s; a batch over it: ${(median(native) / batch).toFixed(2)}; hits are ${equal ? "" : "NOT "}equal, byte for byte`);
        }
    }
} finally {
    rmSync(folder, { recursive: true });
    await bench.end();
}
