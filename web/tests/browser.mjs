// In headless Chromium: answers and pictures equal the native ones, and the demonstration page does what it says, under its content
// security policy, on a phone and by keyboard. Usage: browser.mjs TOOLS [SCREENSHOTS]

import assert from "node:assert/strict";
import { existsSync, mkdirSync, readFileSync, truncateSync, unlinkSync, writeFileSync } from "node:fs";
import path from "node:path";

import { difference } from "./answers.mjs";
import { launch, serve, step, web } from "./chromium.mjs";
import { glb, gltf, hills, stl } from "./files.mjs";

const [tools, shots = path.join(web, "target", "screenshots")] = process.argv.slice(2);
mkdirSync(shots, { recursive: true });
const server = await serve();
const { root } = server;
/** The same files for pages that are isolated. */
const isolated = await serve(true);
const { missing } = await import("../pkg/threads/splitplane_threads.js");
const hasThreads = missing === undefined;
if (!hasThreads) console.log(`NOT TESTED: threads: ${missing}`);
const snapshot = (name) => readFileSync(path.join(web, "..", "tests", "snapshots", `suite__web__${name}.snap`), "utf8");

const browser = await launch(tools);
const problems = [];

/** A page whose complaints are all kept. */
async function open(address, settings, from = root) {
    const page = await browser.newPage(settings);
    page.setDefaultTimeout(120_000);
    page.on("pageerror", (error) => problems.push(`${address}: ${error.stack ?? error}`));
    page.on("crash", () => problems.push(`${address}: the page crashed`));
    page.on("console", (message) => message.type() === "error" && problems.push(`${address}: ${message.text()}`));
    await page.goto(`${from}${address}`);
    return page;
}

const shown = (page, wanted = {}) =>
    page.waitForFunction((wanted) => {
        const all = window.shown !== undefined && Object.entries(wanted).every(([key, value]) => window.shown[key] === value);
        return all || window.problem ? (window.problem ?? window.shown) : false;
    }, wanted).then((handle) => handle.jsonValue());

/** How many colours the canvas has: a picture has many. */
const colours = (page) =>
    page.evaluate(() => {
        const canvas = document.getElementById("picture");
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        return new Set(new Uint32Array(data.buffer)).size;
    });

try {
    await step("digests, hits, points, files and pictures equal the native ones", async () => {
        const page = await open("/blank.html");
        const found = await page.evaluate(async () => {
            const [api, { all, pictures }] = await Promise.all([import("/js/index.js"), import("/tests/answers.mjs")]);
            await api.init();
            const raw = await import("/target/page/pkg/splitplane.js");
            const { memory } = await raw.default();
            return { ...all(api), web_pictures: pictures({ Page: raw.Page, memory }) };
        });
        assert.equal(Object.keys(found).length, 4);
        for (const [name, lines] of Object.entries(found)) assert.equal(difference(lines, snapshot(name)), null, name);
        await page.close();
    });

    await step("threads: refused where they cannot be", async () => {
        const page = await open("/blank.html");
        const refused = await page.evaluate(async () => {
            const api = await import("/js/index.js");
            const { code, message } = await api.initThreads().catch((error) => error);
            return { why: api.whyNoThreads(), code, message };
        });
        assert.match(refused.why, /not isolated.*Cross-Origin-Opener-Policy/);
        assert.equal(refused.code, "threads");
        assert.ok(refused.message.includes(refused.why));
        await page.close();
    });

    if (hasThreads) await step("threads: the native answers in a worker, and errors where one cannot begin or ends", async () => {
        const page = await open("/blank.html", undefined, isolated.root);
        const window = await page.evaluate(async () => {
            const { whyNoThreads } = await import("/js/index.js");
            return { why: whyNoThreads(), isIsolated: crossOriginIsolated };
        });
        assert.ok(window.isIsolated);
        assert.match(window.why, /window's own thread/);
        const asked = async (what) => {
            const found = await page.evaluate((what) => {
                const worker = new Worker("/tests/threads-worker.mjs", { type: "module" });
                return new Promise((resolve, reject) => {
                    worker.onmessage = ({ data }) => resolve(data);
                    worker.onerror = ({ message }) => reject(new Error(message));
                    worker.postMessage(what);
                }).finally(() => worker.terminate());
            }, what);
            assert.equal(found.error, undefined, found.error);
            return found;
        };
        const { before, ...found } = await asked("nothing");
        const codes = Object.values(before).map((refused) => refused?.code ?? refused);
        assert.deepEqual(codes, [null, false, "config", "config", "config", "type", "config", "type", "not-ready"]);
        assert.deepEqual([found.threads, found.again.code, found.ended.code, found.little.code], [3, "config", "cancelled", "out-of-memory"]);
        assert.deepEqual([found.aborted.code, found.aborted.cause, found.isOrdered, found.inner], ["cancelled", "enough", true, 1]);
        assert.equal(Object.keys(found.lines).length, 3);
        for (const [name, lines] of Object.entries(found.lines)) assert.equal(difference(lines, snapshot(name)), null, name);
        assert.ok(found.found > 1000);

        const { refused, about } = await asked("noScript");
        assert.equal(refused.code, "threads");
        assert.equal(about.threads, 1);
        const { built, later, isReady } = await asked("traps");
        assert.deepEqual([built.code, later.code, isReady], ["crashed", "crashed", false]);
        assert.match(built.text, /a thread of the compiled part has ended/);
        await page.close();
        // The script that is not there.
        for (const problem of problems.filter((text) => /404/.test(text))) problems.splice(problems.indexOf(problem), 1);
    });

    const page = await open("/target/page/index.html?scene=cornell", { viewport: { width: 960, height: 800 }, acceptDownloads: true });
    await step("the page shows its first scene", async () => {
        const first = await shown(page, { scene: "cornell", samples: 4 });
        assert.equal(first.scene, "cornell");
        assert.match(first.digest, /^[0-9a-f]{16}$/);
        // The digest is the native one, as the snapshot of pictures has it.
        assert.ok(snapshot("web_pictures").includes(`cornell ${first.digest} `));
        assert.ok((await colours(page)) > 500);
        await page.screenshot({ path: path.join(shots, "cornell.png"), fullPage: true });
    });

    if (hasThreads) await step("the page on all cores where it is isolated, with the same pictures", async () => {
        const cores = await page.evaluate(() => navigator.hardwareConcurrency);
        assert.match(await page.textContent("#threads"), /^1, since the page is not isolated/);
        const many = await open("/target/page/index.html?scene=cornell", { viewport: { width: 960, height: 800 } }, isolated.root);
        const first = await shown(many, { scene: "cornell", samples: 4 });
        assert.ok(snapshot("web_pictures").includes(`cornell ${first.digest} `));
        assert.equal(await many.textContent("#threads"), cores === 1 ? "1, since this machine has one core" : String(Math.min(64, cores)));
        if (cores > 1) assert.match(await many.textContent("#by"), /^the CPU, \d+ threads, simd128$/);
        const picture = (from) => from.evaluate(() => document.getElementById("picture").toDataURL());
        assert.equal(await picture(many), await picture(page));
        await many.screenshot({ path: path.join(shots, "threads.png"), fullPage: true });
        await many.selectOption("#light", "2");
        await shown(many, { light: 2, samples: 4 });
        // WebGPU is in the other compiled part, and the scene comes back with it; this browser has none.
        await many.check('input[name="backend"][value="gpu"]');
        await many.waitForFunction(() => window.onGpu?.state === "failed");
        assert.match(await many.textContent("#threads"), /^1, since/);
        assert.equal((await shown(many, { scene: "cornell", light: 2, samples: 4 })).digest, first.digest);
        await many.evaluate(() => delete window.shown);
        await many.check('input[name="backend"][value="cpu"]');
        assert.equal((await shown(many, { scene: "cornell", light: 2, samples: 4 })).digest, first.digest);
        assert.equal(await many.textContent("#threads"), String(Math.min(64, cores)));
        assert.equal(await many.isVisible("#error"), false);
        await many.close();
    });

    await step("another scene, the costs of rays, each accuracy", async () => {
        await page.selectOption("#scene", "gallery");
        await shown(page, { scene: "gallery" });
        await page.screenshot({ path: path.join(shots, "gallery.png"), fullPage: true });
        for (const accuracy of [0, 2, 1]) {
            await page.check(`input[name="accuracy"][value="${accuracy}"]`);
            await shown(page, { accuracy });
        }
        for (const number of [0, 1, 2]) assert.match(await page.textContent(`#time-${number}`), / m?s$/);
        await page.check('input[name="view"][value="1"]');
        await shown(page, { view: 1 });
        assert.match(await page.textContent("#status"), /nodes and triangles/);
        await page.screenshot({ path: path.join(shots, "costs.png"), fullPage: true });
        await page.check('input[name="view"][value="0"]');
        await shown(page, { view: 0 });
    });

    await step("accuracy and speed of one view, side by side", async () => {
        await page.waitForFunction(() => window.judged !== undefined);
        const rows = await page.evaluate(() => window.judged);
        const [exact, watertight, fast] = rows;
        assert.deepEqual(rows.map(({ accuracy }) => accuracy), [2, 1, 0]);
        assert.ok(exact.rays > 10_000 && rows.every(({ rays, took }) => rays === exact.rays && took > 0));
        assert.equal(exact.other + exact.lost + watertight.lost, 0);
        assert.ok(fast.lost <= fast.other && fast.other < exact.rays / 100);
        assert.equal(await page.textContent("#lost-1"), "none");
        assert.match(await page.textContent("#rate-2"), /^\d+\.\d\d$/);
    });

    await step("the boxes of the tree", async () => {
        const plain = await colours(page);
        await page.check("#show-boxes");
        const few = await shown(page, { boxes: 4 });
        assert.ok(few.boxCount >= 2 && few.boxCount <= 16);
        assert.notEqual(await colours(page), plain);
        await page.screenshot({ path: path.join(shots, "boxes.png"), fullPage: true });
        await page.focus("#boxes");
        await page.keyboard.press("Home");
        const root = await shown(page, { boxes: 0 });
        assert.equal(root.boxCount, 1);
        await page.uncheck("#show-boxes");
        await shown(page, { boxes: null });
    });

    await step("light by photons and by paths", async () => {
        await page.evaluate(() => (document.getElementById("samples").value = "0"));
        for (const light of ["2", "1", "0"]) {
            await page.selectOption("#light", light);
            await shown(page, { light: Number(light), samples: 1 });
            assert.ok((await colours(page)) > 500);
            if (light === "2") await page.screenshot({ path: path.join(shots, "photons.png"), fullPage: true });
        }
        await page.evaluate(() => (document.getElementById("samples").value = "2"));
        await page.check('input[name="view"][value="0"]');
    });

    await step("turned by keyboard and by hand, and put back", async () => {
        const picture = () => page.evaluate(() => document.getElementById("picture").toDataURL());
        const settled = async (work) => {
            await page.evaluate(() => delete window.shown);
            await work();
            await shown(page);
            return picture();
        };
        // With as many samples as the next pictures have.
        const first = await settled(() => page.click("#home"));
        await page.focus("#picture");
        const turned = await settled(() => page.keyboard.press("ArrowLeft"));
        assert.notEqual(turned, first);
        const box = await page.locator("#picture").boundingBox();
        const dragged = await settled(async () => {
            await page.mouse.move(box.x + 200, box.y + 100);
            await page.mouse.down();
            await page.mouse.move(box.x + 260, box.y + 120, { steps: 3 });
            await page.mouse.up();
        });
        assert.notEqual(dragged, turned);
        assert.equal(await settled(() => page.click("#home")), first);
    });

    await step("measurements go to a file", async () => {
        const [download] = await Promise.all([page.waitForEvent("download"), page.click("#measure")]);
        const row = JSON.parse(readFileSync(await download.path(), "utf8"));
        assert.equal(row.scene, "gallery");
        assert.equal(row.frames.length, 3);
        assert.ok(row.buildMs > 0 && row.frames.every(({ ms, raysPerSecond }) => ms > 0 && raysPerSecond > 0));
    });

    const give = (page, name, bytes) => page.setInputFiles("#file", { name, mimeType: "text/plain", buffer: Buffer.from(bytes) });
    await step("glTF, OBJ, PLY and STL files, broken ones, and one that is too large", async () => {
        await give(page, "tetrahedron.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
        const own = await shown(page, { scene: "tetrahedron.obj" });
        assert.equal(own.triangles, 4);
        const head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n";
        await give(page, "one.ply", `${head}property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n`);
        assert.equal((await shown(page, { scene: "one.ply" })).triangles, 1);
        await give(page, "two.stl", stl([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]]));
        assert.equal((await shown(page, { scene: "two.stl" })).triangles, 2);
        // Nodes, camera, light and material of a glTF file; the same in one file, and in two that come together.
        const { root, bin } = gltf();
        await give(page, "squares.glb", glb());
        const one = await shown(page, { scene: "squares.glb" });
        assert.equal(one.triangles, 4);
        const [left, middle] = await page.evaluate(() => {
            const { width, height } = document.getElementById("picture");
            const at = (x) => [...document.getElementById("picture").getContext("2d").getImageData(x * width, 0.5 * height, 1, 1).data];
            return [at(0.35), at(0.5)];
        });
        assert.ok(left[0] > 3 * left[1] && left[0] > 3 * left[2], `the square is red, not ${left}`);
        assert.ok(middle[2] > middle[0], `there is nothing between both squares, but the sky, not ${middle}`);
        await page.screenshot({ path: path.join(shots, "gltf.png"), fullPage: true });
        await page.setInputFiles("#file", [
            { name: "a b.bin", mimeType: "", buffer: bin },
            { name: "two.gltf", mimeType: "", buffer: Buffer.from(JSON.stringify({ ...root, buffers: [{ byteLength: 60, uri: "a%20b.bin" }] })) },
        ]);
        assert.equal((await shown(page, { scene: "two.gltf" })).digest, one.digest);
        for (const [name, bytes, text] of [
            ["cut.ply", "ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n", /cut\.ply/],
            ["other.txt", "v 0 0 0\n", /none of them/],
            ["cut.stl", stl([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]).subarray(0, 90), /cut\.stl/],
            ["cut.glb", glb().subarray(0, 100), /cut\.glb/],
            ["far.gltf", JSON.stringify({ ...gltf().root, buffers: [{ byteLength: 60, uri: "far.bin" }] }), /far\.bin; choose that file together/],
            ["bad.gltf", "{", /bad\.gltf/],
            ["empty.obj", "", /no faces/],
            ["bad.obj", "v 0 0 0\nf 1 2 3\n", /line 2/],
            ["noise.obj", [0xff, 0xfe, 0x00, 0x80], /no text/],
        ]) {
            await give(page, name, bytes);
            await page.waitForFunction(() => window.problem);
            assert.match(await page.textContent("#error"), text);
            assert.ok(await page.isVisible("#error"));
        }
        const large = path.join(shots, "large.obj");
        writeFileSync(large, "");
        truncateSync(large, 500_000_000);
        await page.setInputFiles("#file", large);
        await page.waitForFunction(() => /500,000,000 bytes/.test(window.problem ?? ""));
        unlinkSync(large);
        // The page is as alive as before.
        await page.selectOption("#scene", "spheres");
        assert.equal((await shown(page, { scene: "spheres" })).scene, "spheres");
        assert.equal(await page.isVisible("#error"), false);
        await page.screenshot({ path: path.join(shots, "spheres.png"), fullPage: true });
    });

    /** Chooses values of controls in one task, so that nothing happens in between. */
    const choose = (from, values) =>
        from.evaluate((values) => {
            for (const [id, value] of values) {
                document.getElementById(id).value = value;
                document.getElementById(id).dispatchEvent(new Event("change"));
            }
        }, values);
    /** A page whose worker has other text at one place. */
    const planted = async (place, text, then) => {
        const own = await browser.newPage({ acceptDownloads: true });
        const plant = async (route) => {
            const response = await route.fetch();
            const before = await response.text();
            const body = before.replace(place, text);
            assert.notEqual(body, before);
            await route.fulfill({ response, body });
        };
        await own.route("**/worker.js", plant, { times: 1 });
        await own.goto(`${root}/target/page/index.html?scene=cornell`);
        await shown(own, { scene: "cornell" });
        await then(own);
        await own.close();
    };

    await step("a glTF file that names another one a hundred thousand times", async () => {
        const buffers = Array.from({ length: 100_000 }, () => ({ byteLength: 60_000, uri: "a.bin" }));
        await page.setInputFiles("#file", [
            { name: "a.bin", mimeType: "", buffer: Buffer.alloc(60_000) },
            { name: "many.gltf", mimeType: "", buffer: Buffer.from(JSON.stringify({ ...gltf().root, buffers })) },
        ]);
        await page.waitForFunction(() => window.problem);
        assert.match(await page.textContent("#error"), /many\.gltf cannot be read: with what it names it takes more than the 402,653,184 bytes/);
        assert.match(await page.textContent("#status"), /not opened/);
    });

    await step("a file that is read for long: a tree that is chosen meanwhile is built, and a scene comes in its place", async () => {
        const slow = "for (let at = 0;";
        await planted(slow, `await new Promise((resume) => setTimeout(resume, 700)); ${slow}`, async (own) => {
            await give(own, "two.stl", stl([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]]));
            await choose(own, [["preset", "best"]]);
            assert.equal((await shown(own, { scene: "two.stl" })).preset, "best");
            await give(own, "one.stl", stl([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]));
            await choose(own, [["scene", "spheres"]]);
            await shown(own, { scene: "spheres" });
            await own.waitForTimeout(1500);
            assert.equal(await own.evaluate(() => window.shown.scene), "spheres");
            assert.equal(await own.isVisible("#error"), false);
            // It changes while it is read.
            const file = path.join(shots, "changes.obj");
            writeFileSync(file, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
            await own.setInputFiles("#file", file);
            writeFileSync(file, "v 0 0 0\n");
            await own.waitForFunction(() => window.problem);
            unlinkSync(file);
            assert.match(await own.textContent("#error"), /changes\.obj cannot be read/);
            await own.selectOption("#scene", "cornell");
            await shown(own, { scene: "cornell", preset: "best" });
        });
    });

    await step("files of the most bytes that are read: 8 million triangles, each a point, and as many of hills", async () => {
        const most = 384 * 1024 * 1024;
        const [points, hilly] = ["points.stl", "hills.stl"].map((name) => path.join(shots, name));
        const head = Buffer.alloc(84);
        const triangles = Math.floor((most - head.length) / 50);
        head.writeUInt32LE(triangles, 80);
        writeFileSync(points, head);
        // All other bytes are zero.
        truncateSync(points, head.length + 50 * triangles);
        await page.setInputFiles("#file", points);
        const found = await shown(page, { scene: "points.stl" });
        unlinkSync(points);
        assert.equal(found.triangles, triangles, found);
        const many = hills(hilly, Math.floor(Math.sqrt(triangles / 2)));
        for (const from of hasThreads ? [root, isolated.root] : [root]) {
            const own = await open("/target/page/index.html?scene=cornell", undefined, from);
            await shown(own, { scene: "cornell" });
            await own.setInputFiles("#file", hilly);
            // Its tree, or what says that the memory was too little.
            const told = await shown(own, { scene: "hills.stl" });
            console.log(`${many} triangles: ${typeof told === "string" ? told : `read in ${Math.round(told.readMs)} ms, tree in ${Math.round(told.buildMs)} ms`}`);
            assert.ok(typeof told === "string" ? /memory/.test(told) : told.triangles === many, told);
            await own.selectOption("#scene", "gallery");
            await shown(own, { scene: "gallery" });
            await own.close();
        }
        unlinkSync(hilly);
        await page.selectOption("#scene", "cornell");
        await shown(page, { scene: "cornell" });
    });

    await step("a build that takes long is given up for another scene", async () => {
        const file = path.join(shots, "long.stl");
        hills(file, 700);
        const own = await open("/target/page/index.html?scene=cornell");
        await shown(own, { scene: "cornell" });
        const before = own.workers().length;
        const another = own.waitForEvent("worker");
        await own.selectOption("#preset", "best");
        await shown(own, { preset: "best" });
        await own.setInputFiles("#file", file);
        await own.waitForFunction(() => /^Building the tree: /.test(document.getElementById("status").textContent));
        await own.waitForTimeout(1100);
        await choose(own, [["scene", "spheres"]]);
        await another;
        assert.equal((await shown(own, { scene: "spheres" })).preset, "best");
        assert.equal(own.workers().length, before);
        assert.equal(await own.isVisible("#error"), false);
        unlinkSync(file);
        await own.close();
    });

    await step("what is measured is not saved under the name of another scene", async () => {
        let saved = 0;
        const own = await browser.newPage({ acceptDownloads: true });
        own.on("download", () => (saved += 1));
        await own.goto(`${root}/target/page/index.html?scene=cornell`);
        await shown(own, { scene: "cornell" });
        await own.evaluate(() => {
            document.getElementById("measure").click();
            document.getElementById("scene").value = "spheres";
            document.getElementById("scene").dispatchEvent(new Event("change"));
        });
        await shown(own, { scene: "spheres" });
        await own.waitForTimeout(500);
        assert.equal(saved, 0);
        const [download] = await Promise.all([own.waitForEvent("download"), own.click("#measure")]);
        assert.equal(JSON.parse(readFileSync(await download.path(), "utf8")).scene, "spheres");
        assert.equal(saved, 1);
        await own.close();
    });

    await step("another tree can be chosen while one is built", async () => {
        await choose(page, [["scene", "spheres"], ["preset", "best"], ["scene", "cornell"]]);
        assert.equal((await shown(page, { scene: "cornell", preset: "best" })).preset, "best");
        await page.selectOption("#preset", "fast");
        await page.selectOption("#scene", "spheres");
        await shown(page, { scene: "spheres", preset: "fast" });
    });

    await step("a worker that ends is said to have ended, and another one goes on", async () => {
        const trap = 'builtBy = preset; if (preset === "best") throw new WebAssembly.RuntimeError("planted");';
        await planted("builtBy = preset;", trap, async (own) => {
            await own.selectOption("#preset", "best");
            await own.waitForFunction(() => window.problem);
            assert.match(await own.textContent("#error"), /has ended \(planted\)/);
            await own.waitForFunction(() => document.getElementById("status").textContent === "Choose another scene.");
            await own.selectOption("#scene", "spheres");
            assert.equal((await shown(own, { scene: "spheres", preset: "best" })).preset, "best");
            assert.equal(await own.isVisible("#error"), false);
        });
    });

    await step("without WebGPU the page says so, and goes on", async () => {
        await page.check('input[name="backend"][value="gpu"]');
        await page.waitForFunction(() => window.onGpu?.state === "failed");
        assert.match(await page.textContent("#gpu"), /^No tree by the GPU: .*WebGPU.* The CPU does the work\.$/);
        await page.check('input[name="backend"][value="cpu"]');
        assert.equal(await page.textContent("#gpu"), "");
        assert.equal(await page.isVisible("#error"), false);
    });

    await step("its content security policy holds", async () => {
        const ran = await page.evaluate(() => {
            const script = document.createElement("script");
            script.textContent = "window.injected = true";
            document.head.append(script);
            return window.injected === true;
        });
        // The browser's own complaints about that are what is wanted.
        await page.waitForTimeout(200);
        const wanted = problems.filter((problem) => /Content Security Policy/.test(problem));
        for (const problem of wanted) problems.splice(problems.indexOf(problem), 1);
        assert.equal(ran, false);
        assert.ok(wanted.length >= 1);
    });

    await step("everything has a name for a screen reader", async () => {
        const session = await page.context().newCDPSession(page);
        const { nodes } = await session.send("Accessibility.getFullAXTree");
        const used = nodes.filter(({ ignored, properties = [] }) => !ignored && properties.some(({ name, value }) => name === "focusable" && value.value));
        const roles = used.map(({ role }) => role.value);
        for (const role of ["combobox", "radio", "checkbox", "slider", "button", "link"]) assert.ok(roles.includes(role), `no ${role} among ${roles}`);
        const nameless = used.filter(({ role, name }) => role.value !== "RootWebArea" && !name?.value.trim());
        assert.deepEqual(nameless.map(({ role }) => role.value), []);
        // What changes by itself is read out.
        assert.ok(nodes.filter(({ role }) => role?.value === "status").length >= 2);
        assert.equal(await page.evaluate(() => document.documentElement.lang), "en");
        assert.match(await page.getAttribute("#picture", "aria-label"), /spheres, .* triangles/);
    });

    await step("all of it is reached and set by keyboard", async () => {
        await page.evaluate(() => document.activeElement.blur());
        await page.focus(".skip");
        const reached = new Set();
        for (let i = 0; i < 60; i += 1) {
            const now = await page.evaluate(() => {
                const { id, name, tagName, className } = document.activeElement;
                const { outlineStyle } = getComputedStyle(document.activeElement);
                return { name: id || name || className || tagName, isSeen: outlineStyle !== "none" };
            });
            if (now.name === "BODY") break;
            // The first was not given by a key.
            assert.ok(i === 0 || now.isSeen, `the focus on ${now.name} is not seen`);
            reached.add(now.name);
            await page.keyboard.press("Tab");
        }
        const wanted = await page.evaluate(() =>
            [...document.querySelectorAll("a, canvas, input, select, button")].filter((element) => !element.disabled && element.checkVisibility())
                .map(({ type, id, name, className }) => (type === "radio" ? name : id || className)),
        );
        assert.deepEqual(new Set(wanted), reached);
        await page.focus('input[name="view"][value="0"]');
        await page.keyboard.press("ArrowDown");
        await shown(page, { view: 1 });
        await page.keyboard.press("ArrowUp");
        await shown(page, { view: 0 });
    });

    await step("a file that is dropped, and a page that the browser stops meanwhile", async () => {
        await page.evaluate(() => {
            const given = new DataTransfer();
            given.items.add(new File(["v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n"], "dropped.obj"));
            document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: given, bubbles: true, cancelable: true }));
        });
        const session = await page.context().newCDPSession(page);
        await session.send("Page.setWebLifecycleState", { state: "frozen" });
        await new Promise((pass) => setTimeout(pass, 500));
        await session.send("Page.setWebLifecycleState", { state: "active" });
        assert.equal((await shown(page, { scene: "dropped.obj" })).triangles, 2);
    });

    await step("on a phone nothing is cut off", async () => {
        const phone = await open("/target/page/index.html?scene=spheres", { viewport: { width: 360, height: 740 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true });
        await shown(phone, { scene: "spheres" });
        assert.ok(await phone.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
        const [coarse, whole] = await phone.evaluate(() => [window.firstPicture, window.firstWhole].map(Math.round));
        console.log(`75,498 triangles: a first picture, an eighth as wide, after ${coarse} ms, one of all pixels after ${whole} ms`);
        await phone.screenshot({ path: path.join(shots, "phone.png"), fullPage: true });
        await phone.emulateMedia({ colorScheme: "dark" });
        await phone.screenshot({ path: path.join(shots, "phone-dark.png"), fullPage: true });
        await phone.close();
    });
    const example = path.join(web, "target", "vite", "dist");
    if (existsSync(example)) await step("the example for Vite, as it was bundled", async () => {
        for (const [name, told] of [["index", /^48,000 triangles, digest [0-9a-f]{16}, simd128$/], ["threads", /of a million rays hit, in \d+ ms on (\d+ threads|one thread)/]]) {
            const own = await open(`/target/vite/dist/${name}.html`, undefined, isolated.root);
            await own.waitForFunction(() => document.getElementById("told").textContent !== "Loading…" && document.getElementById("told").textContent !== "");
            assert.match(await own.textContent("#told"), told);
            if (name === "index") {
                await own.mouse.move(325, 280);
                await own.waitForFunction(() => /^triangle \d+, \d\.\d{4} away$/.test(document.getElementById("told").textContent));
            }
            await own.close();
        }
    });
    else console.log("NOT TESTED: the example for Vite was not bundled");
    assert.deepEqual(problems, []);
} catch (error) {
    for (const problem of problems) console.error(problem);
    console.error(error);
    process.exitCode = 1;
} finally {
    await browser.close();
    server.close();
    isolated.close();
}
