// The package on WebGPU, in headless Chromium with SwiftShader: digests, hits and files equal the native ones; a lost device, work that is
// ended, and a page in the background end in errors or answers. Usage: webgpu.mjs TOOLS [SCREENSHOTS]

import assert from "node:assert/strict";
import { mkdirSync, readFileSync } from "node:fs";
import path from "node:path";

import { launch, serve, step, web } from "./chromium.mjs";

const [tools, shots = path.join(web, "target", "screenshots")] = process.argv.slice(2);
mkdirSync(shots, { recursive: true });
const server = await serve();
const snapshot = (name) => readFileSync(path.join(web, "..", "tests", "snapshots", `suite__web__${name}.snap`), "utf8").split("\n");
const SWIFTSHADER = [
    "--enable-unsafe-webgpu", "--enable-features=Vulkan", "--use-webgpu-adapter=swiftshader", "--use-vulkan=swiftshader", "--disable-vulkan-surface",
];
const problems = [];

async function blank(browser) {
    const page = await browser.newPage();
    page.setDefaultTimeout(600_000);
    page.on("pageerror", (error) => problems.push(String(error.stack ?? error)));
    page.on("crash", () => problems.push("the page crashed"));
    page.on("console", (message) => message.type() === "error" && problems.push(message.text()));
    await page.goto(`${server.root}/blank.html`);
    return page;
}

const run = (page, name, ...all) =>
    page.evaluate(async ([name, all]) => (await import("/tests/gpu-page.mjs"))[name](...all), [name, all]);

const browser = await launch(tools, SWIFTSHADER);
try {
    const page = await blank(browser);
    if (!(await page.evaluate(async () => (await navigator.gpu?.requestAdapter()) != null))) {
        console.log("this Chromium has no WebGPU");
        process.exit(3);
    }

    await step("the GPU is opened and tested", async () => {
        const opened = await run(page, "open");
        console.log(`  ${opened.adapter}: ${opened.parity}, opened in ${(opened.milliseconds / 1000).toFixed(1)} s`);
        assert.match(opened.adapter, /swiftshader/i);
        assert.equal(opened.parity, "bitwise", opened.difference);
        assert.equal(opened.difference, null);
        assert.equal(opened.lost, null);
    });

    await step("digests, hits and files are the native ones", async () => {
        for (const [name, presets] of [["web_sphere", ["fast", "balanced"]], ["web_noise", ["fast"]]]) {
            const { lines, longest } = await run(page, "answers", name, presets);
            const native = snapshot(name);
            assert.ok(lines.length >= 8);
            for (const line of lines) assert.ok(native.includes(line), `${name}: "${line}" is not among the native lines`);
            console.log(`  ${name}: ${lines.length} lines; no event for ${Math.round(longest)} ms at most`);
        }
        // The comparison can fail.
        assert.ok(!snapshot("web_sphere").includes(snapshot("web_noise").find((line) => line.startsWith("digest fast"))));
    });

    await step("scenes of instances", async () => {
        const { lines, found, isOther } = await run(page, "objects");
        for (const line of lines) assert.ok(snapshot("web_instances").includes(line), `"${line}" is not among the native lines`);
        assert.ok(lines.length === 5 && isOther);
        const wanted = { stale: "stale", early: "stale", exact: "config", unknown: "unknown", busy: "busy", under: "busy", ended: "cancelled", edited: "stale", freed: "freed" };
        for (const [name, code] of Object.entries(wanted)) assert.equal(found[name]?.code, code, `${name}: ${JSON.stringify(found[name])}`);
    });

    await step("several at once", async () => {
        const { digests, isSame } = await run(page, "together");
        for (const [place, name] of ["web_noise", "web_sphere"].entries()) assert.ok(snapshot(name).includes(`digest fast: ${digests[place]}`));
        assert.ok(isSame);
    });

    await step("work that is ended, and misuse", async () => {
        const found = await run(page, "ended");
        const wanted = {
            abort: "cancelled", progress: "cancelled", before: "cancelled", best: "config", type: "type", shape: "shape", mesh: "mesh",
            memory: "out-of-memory", rays: "shape", accuracy: "config", batch: "cancelled", freed: "freed",
        };
        for (const [name, code] of Object.entries(wanted)) {
            assert.equal(found[name]?.code, code, `${name}: ${JSON.stringify(found[name])}`);
            assert.ok(found[name].isOurs, name);
        }
        assert.equal(found.abort.cause, "enough");
        assert.equal(found.thrown.message, "own");
        assert.ok(found.empty);
        assert.ok(snapshot("web_noise").includes(`digest fast: ${found.digest}`));
    });

    await step("one choice for CPU and GPU", async () => {
        const [auto, cpu, gpu] = await run(page, "choice");
        assert.deepEqual([auto.name, cpu.name, gpu.name], ["cpu", "cpu", "gpu"]);
        assert.match(auto.reason, /^auto: the CPU, since `.*` is software$/);
        for (const one of [auto, cpu]) assert.deepEqual([one.digest, one.hits], [gpu.digest, gpu.hits]);
    });

    const isLost = (found) => {
        for (const one of [found.query, found.build]) assert.equal(one?.code, "device-lost", JSON.stringify(found));
        // What was under way is done, or says so.
        for (const one of found.during) assert.ok(one === null || one.code === "device-lost", JSON.stringify(found));
        assert.match(found.lost, /lost/);
        assert.ok(found.isSame);
        assert.equal(found.freed.code, "freed");
    };
    await step("a page that the browser stops, as in the background", async () => {
        const session = await page.context().newCDPSession(page);
        const work = run(page, "together");
        await session.send("Page.setWebLifecycleState", { state: "frozen" });
        await new Promise((pass) => setTimeout(pass, 1500));
        await session.send("Page.setWebLifecycleState", { state: "active" });
        const { digests, isSame } = await work;
        assert.ok(snapshot("web_noise").includes(`digest fast: ${digests[0]}`));
        assert.ok(isSame);
    });

    // As `chrome://gpucrash` does it.
    const crash = async () => (await browser.newBrowserCDPSession()).send("Browser.crashGpuProcess");
    await step("the browser's GPU process ends in the middle of work", async () => {
        await run(page, "underWay");
        await crash();
        const found = await run(page, "crashed");
        for (const [name, one] of Object.entries({ ...found.during, query: found.query, update: found.update })) {
            assert.ok(one?.isOurs, `${name}: ${JSON.stringify(found)}`);
            assert.ok(["device-lost", "no-webgpu"].includes(one.code), `${name}: ${JSON.stringify(one)}`);
        }
        assert.match(found.lost, /lost/);
        assert.equal(found.again.parity, "bitwise");
        assert.ok(snapshot("web_noise").includes(`digest fast: ${found.again.digest}`));
        assert.ok(found.again.isSame);
    });

    await step("a device that is destroyed in the middle of work", async () => isLost(await run(page, "lost")));
    assert.deepEqual(problems, []);

    await step("the demonstration page builds on both, side by side", async () => {
        const shown = await browser.newPage({ viewport: { width: 960, height: 1000 } });
        shown.setDefaultTimeout(900_000);
        shown.on("pageerror", (error) => problems.push(String(error.stack ?? error)));
        await shown.goto(`${server.root}/target/page/index.html?scene=cornell`);
        await shown.waitForFunction(() => window.shown !== undefined || window.problem);
        await shown.check('input[name="backend"][value="gpu"]');
        await shown.waitForFunction(() => window.onGpu !== undefined);
        const onGpu = await shown.evaluate(() => window.onGpu);
        assert.equal(onGpu.state, "built", onGpu.text);
        assert.equal(await shown.textContent("#gpu-digest"), await shown.textContent("#digest"));
        assert.match(await shown.textContent("#gpu"), /swiftshader \(software\): equal to the CPU bit for bit.*Both trees are the same\./);
        for (const id of ["built", "gpu-built"]) assert.match(await shown.textContent(`#${id}`), / m?s$/);
        await shown.screenshot({ path: path.join(shots, "webgpu.png"), fullPage: true });

        // Pictures by the GPU, and a row that compares them.
        const settled = (wanted) => shown.waitForFunction((wanted) =>
            window.problem ?? (window.shown && Object.entries(wanted).every(([key, value]) => window.shown[key] === value) ? window.shown : false), wanted)
            .then((handle) => handle.jsonValue());
        const picture = () => shown.evaluate(() => document.getElementById("picture").toDataURL());
        const own = await picture();
        await shown.check('input[name="by"][value="gpu"]');
        const onDevice = await settled({ by: "gpu", madeBy: "gpu" });
        assert.equal(onDevice.why, null, JSON.stringify(onDevice));
        assert.equal(await picture(), own);
        assert.match(await shown.textContent("#by"), /^the GPU, .*swiftshader/i);
        // Exact ones are those of the CPU too, which answers what the GPU leaves undecided.
        await shown.check('input[name="accuracy"][value="2"]');
        const exact = await settled({ accuracy: 2, by: "gpu", madeBy: "gpu" });
        assert.equal(exact.why, null, JSON.stringify(exact));
        const exactPicture = await picture();
        await shown.check('input[name="by"][value="cpu"]');
        await settled({ accuracy: 2, by: "cpu", madeBy: "cpu" });
        assert.equal(await picture(), exactPicture);
        await shown.check('input[name="by"][value="gpu"]');
        // Light by paths is the CPU's.
        await shown.evaluate(() => (document.getElementById("samples").value = "0"));
        await shown.selectOption("#light", "1");
        assert.match((await settled({ light: 1, madeBy: "cpu" })).why, /direct light only/);
        await shown.selectOption("#light", "0");
        await shown.check('input[name="accuracy"][value="1"]');
        const [download] = await Promise.all([shown.waitForEvent("download"), shown.click("#parity")]);
        const row = readFileSync(await download.path(), "utf8");
        const cells = row.split("|").map((cell) => cell.trim());
        assert.equal(cells.length, 9, row);
        assert.match(cells[1], /swiftshader.*WebGPU, software/i);
        assert.equal(cells[4], "bitwise", row);
        assert.match(cells[6], /cornell.*: equal$/);
        assert.match(cells[7], /^[\d,]+ first hits, of which 0 differ, and [\d,]+ pixels, of which 0 differ/);
        await settled({ by: "gpu", madeBy: "gpu" });

        // The GPU process ends while nothing is asked of it: the page says so, goes on by the CPU, and opens the GPU again.
        await crash();
        await shown.waitForFunction(() => window.onGpu.state === "failed");
        assert.match(await shown.textContent("#gpu"), /^No tree by the GPU: .*lost.* The CPU does the work\.$/);
        await settled({ by: "cpu", madeBy: "cpu" });
        assert.ok(await shown.isDisabled('input[name="by"][value="gpu"]'));
        await shown.screenshot({ path: path.join(shots, "lost.png"), fullPage: true });
        await shown.click("#again");
        await shown.waitForFunction(() => window.onGpu !== undefined);
        assert.equal(await shown.evaluate(() => window.onGpu.state), "built");
        assert.equal(await shown.textContent("#gpu-digest"), await shown.textContent("#digest"));
        assert.equal(await shown.isVisible("#again"), false);
        assert.equal(await shown.isVisible("#error"), false);
        await shown.close();
    });
    assert.deepEqual(problems, []);
} catch (error) {
    for (const problem of problems) console.error(problem);
    console.error(error);
    process.exitCode = 1;
} finally {
    await browser.close();
}

// Without WebGPU.
const plain = await launch(tools, ["--disable-features=WebGPUService", "--disable-blink-features=WebGPU"]);
try {
    await step("a browser without WebGPU says so, and the CPU does the work", async () => {
        const page = await blank(plain);
        const found = await page.evaluate(async () => {
            const api = await import("/js/index.js");
            await api.init();
            const error = await api.Backend.open("gpu").catch((error) => error);
            const backend = await api.Backend.open();
            const tree = await backend.build(new Float32Array(9));
            return { code: error.code, name: backend.name, reason: backend.reason, triangles: tree.summary.triangles };
        });
        assert.equal(found.code, "no-webgpu");
        assert.equal(found.name, "cpu");
        assert.match(found.reason, /^auto: the CPU, since /);
        assert.equal(found.triangles, 1);
    });
} catch (error) {
    console.error(error);
    process.exitCode = 1;
} finally {
    await plain.close();
    server.close();
}
