// What is seen and touched; the work is in worker.js.

const $ = (id) => document.getElementById(id);
const canvas = $("picture");
const context = canvas.getContext("2d");
/** Where pictures of fewer pixels are before they are made as large as the canvas. */
const small = document.createElement("canvas");
/** The most pixels of a row. */
const WIDEST = 960;
const ACCURACIES = ["fast", "watertight", "exact"];

let worker = null;
let about = null;
/** What the last scene was opened by, for a worker that has to be started anew. */
let opened = null;
let last = {};
let isReady = false;
/** Whether the worker has WebGPU in the place of threads that it could have; whether it is to open what was open before it. */
let withGpu = false;
let comesBack = false;
/** Counts what the visitor has chosen to open: a file that is still being read gives way to what comes after it. */
let wishes = 0;
/** Counts the scenes and trees that the worker was asked for: what it tells of an earlier one is out of date. */
let choices = 0;
/** Whether the worker is there; since when it has been at a scene or tree, `null` when it is not. */
let hasWorker = false;
let busySince = null;
/** Work that has taken longer than this gives way to the next choice by the end of its worker, in milliseconds. */
const TOO_LONG = 1000;
/** What is measured: the scene and its tree, as they were when that began. */
let measuring = null;
/** The depth of the boxes, as the visitor has chosen it. */
let wantedDepth = 4;

const milliseconds = (time) => (time < 10_000 ? `${time.toFixed(time < 10 ? 1 : 0)} ms` : `${(time / 1000).toFixed(1)} s`);
const whole = (number) => number.toLocaleString("en");

/** Screen readers read it out, but what comes many times a second. */
function say(text, isBrief = false) {
    $("status").ariaBusy = String(isBrief);
    $("status").textContent = text;
}

function complain(text) {
    $("error").hidden = text === null;
    $("error").textContent = text ?? "";
    window.problem = text;
}

function threadsTold() {
    return about.threads === 1 ? "one thread" : `${about.threads} threads`;
}

function chosen(name) {
    return Number(document.querySelector(`input[name="${name}"]:checked`).value);
}

const chosenBackend = () => document.querySelector('input[name="backend"]:checked').value;

const chosenBy = () => document.querySelector('input[name="by"]:checked').value;

function job() {
    const width = Math.min(WIDEST, Math.max(1, Math.round(canvas.clientWidth)));
    return {
        width,
        height: Math.max(1, Math.round((width * 5) / 8)),
        samples: 2 ** Number($("samples").value),
        depth: Number($("depth").value),
        lights: $("lights").checked,
        accuracy: chosen("accuracy"),
        view: chosen("view"),
        light: Number($("light").value),
        by: chosenBy(),
        boxes: $("show-boxes").checked ? Number($("boxes").value) : null,
        judges: $("judges").checked,
    };
}

function draw() {
    if (isReady) worker.postMessage({ do: "draw", job: job() });
}

/** Nothing is shown of what was there before. */
function forget() {
    isReady = false;
    offerGpu(false);
    for (const id of ["measure", "parity"]) $(id).disabled = true;
    for (const id of ["triangles", "read", "built", "digest", "gpu-built", "gpu-digest"]) $(id).textContent = "–";
    if (last.gpu) $("gpu").textContent = "";
}

/** Has the worker do the work of a choice; one that has been at another for long is ended, and the next one opens what is wanted by then. */
function ask(message) {
    if (busySince !== null && performance.now() - busySince > TOO_LONG) {
        comesBack = true;
        begin();
        return;
    }
    choices += 1;
    busySince ??= performance.now();
    worker.postMessage({ ...message, choice: choices, preset: $("preset").value, aspect: 1.6 });
}

function open(what) {
    complain(null);
    forget();
    opened = what;
    // With a file no built-in scene is shown any more, so that each of them can be chosen.
    if (what.builtin === undefined) $("scene").selectedIndex = -1;
    say(`Opening ${what.name}…`);
    ask({ do: "open", ...what });
}

/** The name that a URI of a .gltf file has among the files that came with it. */
const nameOf = (uri) => decodeURIComponent(uri).split("/").pop();

/** The bytes of a file as a URI. */
function inUri(file) {
    return new Promise((resolve, reject) => {
        const reader = new FileReader();
        reader.onload = () => resolve(`data:application/octet-stream;base64,${reader.result.slice(reader.result.indexOf(",") + 1)}`);
        reader.onerror = () => reject(reader.error);
        reader.readAsDataURL(file);
    });
}

/** A .gltf file with what it names inside: the worker cannot read files by their names. */
async function wholeGltf(file, others) {
    let root;
    try {
        root = JSON.parse(await file.text());
    } catch {
        // The reader says where it is broken.
        return file;
    }
    // As text bytes take a third more, and those that are named twice are there twice.
    let bytes = file.size;
    const uris = new Map();
    for (const one of [root?.buffers, root?.images].flatMap((list) => (Array.isArray(list) ? list : []))) {
        if (typeof one?.uri !== "string" || one.uri.startsWith("data:")) continue;
        const found = others.find(({ name }) => name === nameOf(one.uri));
        if (found === undefined) throw new Error(`it names ${one.uri}; choose that file together with it`);
        bytes += 4 * Math.ceil(found.size / 3);
        if (bytes > about.mostBytes) throw new Error(`with what it names it takes more than the ${whole(about.mostBytes)} bytes that this page reads, as text`);
        if (!uris.has(found)) uris.set(found, await inUri(found));
        one.uri = uris.get(found);
    }
    return new Blob([JSON.stringify(root)]);
}

const SCENES = /\.(glb|gltf|obj|ply|stl)$/i;

async function openFiles(files) {
    complain(null);
    wishes += 1;
    const own = wishes;
    const all = [...files];
    const file = all.find(({ name }) => SCENES.test(name)) ?? all[0];
    const bytes = all.reduce((sum, { size }) => sum + size, 0);
    if (bytes > about.mostBytes) {
        complain(`${file.name} has ${whole(bytes)} bytes; ${whole(about.mostBytes)} are the most that this page reads.`);
        say("That file was not opened.");
        return;
    }
    try {
        say(`Reading ${file.name}…`);
        const others = all.filter((other) => other !== file);
        // The worker reads it, so that the page holds no copy of its bytes.
        const read = /\.gltf$/i.test(file.name) ? await wholeGltf(file, others) : file;
        if (own === wishes) open({ file: read, name: file.name });
    } catch (error) {
        if (own !== wishes) return;
        complain(`${file.name} cannot be read: ${error.message}`);
        say("That file was not opened.");
    }
}

function openBuiltin() {
    const name = $("scene").value;
    wishes += 1;
    $("file").value = "";
    open({ builtin: name, name });
}

/** Pictures by the GPU can be had, or no longer. */
function offerGpu(isThere) {
    const [cpu, gpu] = ["cpu", "gpu"].map((name) => document.querySelector(`input[name="by"][value="${name}"]`));
    gpu.disabled = !isThere;
    if (!isThere && gpu.checked) cpu.checked = true;
    $("parity").disabled = !isThere || !isReady;
}

/** Has the tree built on the GPU too, or no longer. */
function chooseBackend() {
    const isOn = chosenBackend() === "gpu";
    for (const id of ["gpu-built", "gpu-digest"]) $(id).textContent = "–";
    offerGpu(false);
    $("gpu").textContent = isOn ? "Looking for a GPU…" : "";
    $("again").hidden = true;
    delete window.onGpu;
    // Threads and WebGPU are in two compiled parts: a worker has one of them.
    if (isOn ? about?.threads === 1 : !withGpu) {
        worker.postMessage({ do: "gpu", isOn });
        return;
    }
    withGpu = isOn;
    comesBack = true;
    begin();
}

const hears = {
    /** What the GPU does. */
    gpu({ state, text, adapter, isSoftware, parity, difference, took, first, digest }) {
        const name = `${adapter}${isSoftware ? " (software)" : ""}`;
        const parities = parity === "bitwise" ? "equal to the CPU bit for bit by its self-test" : `not equal to the CPU bit for bit: ${difference}`;
        if (state === "opening") $("gpu").textContent = "Opening and testing the GPU; the first time its shaders are compiled…";
        if (state === "building") $("gpu").textContent = `${name}: ${parities}. Building…`;
        if (state === "built") {
            const same = digest === last.digest ? "Both trees are the same." : "THE TREES DIFFER.";
            $("gpu").textContent = `${name}: ${parities}. ${same}`;
            $("gpu-built").textContent = milliseconds(took);
            $("gpu-built").title = `the first time, with shaders compiled and memory made: ${milliseconds(first)}`;
            $("gpu-digest").textContent = digest;
            Object.assign(last, { gpu: { adapter, isSoftware, parity, buildMs: took, firstBuildMs: first, digest } });
        }
        if (state === "failed") $("gpu").textContent = `No tree by the GPU: ${text.replace(/\.$/, "")}. The CPU does the work.`;
        $("again").hidden = state !== "failed" || !navigator.gpu;
        const wasByGpu = chosenBy() === "gpu";
        offerGpu(state === "built");
        if (wasByGpu && chosenBy() === "cpu") draw();
        if (state === "built" || state === "failed") window.onGpu = { state, text, adapter, parity, digest };
    },
    ready({ scenes, mostBytes, mostBoxes, version, instructionSet, threads, whyOne }) {
        about = { mostBytes, mostBoxes, version, instructionSet, threads };
        $("threads").textContent = threads > 1 ? String(threads) : `1, since ${whyOne}`;
        if ($("scene").options.length === 0) {
            for (const { name, shows } of scenes) $("scene").add(new Option(`${name}: ${shows.split(";")[0]}`, name));
            const asked = new URLSearchParams(location.search).get("scene");
            $("scene").value = scenes.some(({ name }) => name === asked) ? asked : "gallery";
        }
        $("gpu").textContent = navigator.gpu ? "" : "Your browser has no WebGPU here: the CPU does the work.";
        if (!comesBack) withGpu = false;
        document.querySelector(`input[name="backend"][value="${withGpu ? "gpu" : "cpu"}"]`).checked = true;
        $("again").hidden = true;
        offerGpu(false);
        hasWorker = true;
        for (const id of ["scene", "file"]) $(id).disabled = false;
        if (withGpu) worker.postMessage({ do: "gpu", isOn: true });
        if (opened === null) openBuiltin();
        else if (comesBack) open(opened);
        else say("Choose another scene.");
        comesBack = false;
    },
    opened({ name, took, triangles, notes }) {
        $("triangles").textContent = whole(triangles);
        $("read").textContent = milliseconds(took);
        say(`Building the tree of ${name}…${notes.length > 0 ? ` (${notes.join("; ")})` : ""}`);
        last = { scene: name, triangles, readMs: took };
    },
    progress({ stage, done, total }) {
        say(`Building the tree: ${stage}${total > 0 ? `, ${Math.round((100 * done) / total)} %` : ""}`, true);
    },
    built({ preset, took, digest, nodes, references, bytes, deepest }) {
        busySince = null;
        $("boxes").max = deepest;
        // A shallow tree does not change what is wanted of the next one.
        $("boxes").value = wantedDepth;
        $("boxes-told").value = $("boxes").value;
        offerGpu(false);
        $("built").textContent = milliseconds(took);
        $("digest").textContent = digest;
        for (const id of ["gpu-built", "gpu-digest"]) $(id).textContent = "–";
        delete last.gpu;
        delete window.onGpu;
        for (const number of [0, 1, 2]) $(`time-${number}`).textContent = "";
        forgetTrade();
        Object.assign(last, { preset, buildMs: took, digest, nodes, references, queryBytes: bytes });
        isReady = true;
        $("measure").disabled = false;
        draw();
    },
    picture({ width, height, samples, pixels, edges, took, by, why, paths, shadows, top, isLast, job }) {
        [small.width, small.height] = [width, height];
        small.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(pixels), width, height), 0, 0);
        if (canvas.width !== job.width || canvas.height !== job.height) [canvas.width, canvas.height] = [job.width, job.height];
        context.imageSmoothingEnabled = width === job.width;
        context.drawImage(small, 0, 0, job.width, job.height);
        const boxes = edges === null ? 0 : drawBoxes(edges);
        window.firstPicture ??= performance.now();
        if (width !== job.width) return;
        window.firstWhole ??= performance.now();
        const rays = paths + shadows;
        const cpu = `the CPU, ${threadsTold()}, ${about.instructionSet}`;
        $("by").textContent = by === "gpu" ? `the GPU${last.gpu ? `, ${last.gpu.adapter}` : ""}` : why ? `${cpu}, since ${why}` : cpu;
        if (samples === 1 && job.view === 0) {
            $("frame").textContent = `${milliseconds(took)}, ${width} × ${height}`;
            $("rate").textContent = `${(rays / took / 1000).toFixed(2)} million`;
            if (by === "cpu") $(`time-${job.accuracy}`).textContent = milliseconds(took);
        }
        if (!isLast) return;
        const heat = `what the first ray of each pixel cost, from dark to white: ${whole(top)} nodes and triangles or more`;
        const [one, many] = job.light === 0 ? ["one sample a pixel", "samples a pixel"] : ["one pass", "passes"];
        const light = `${["", "paths, ", "photons, "][job.light]}${samples === 1 ? one : `${samples} ${many}`}, ${ACCURACIES[job.accuracy]}`;
        const most = boxes > about.mostBoxes ? `, of which the ${whole(about.mostBoxes)} largest are drawn` : "";
        const told = job.boxes === null ? "" : `; ${whole(boxes)} boxes at depth ${job.boxes}${most}`;
        const shows = `${job.view === 1 ? heat : light}${told}`;
        say(`${last.scene}: ${shows}`);
        canvas.setAttribute("aria-label", `${last.scene}, ${whole(last.triangles)} triangles; ${shows}`);
        window.shown = { ...last, ...job, took, rays, madeBy: by, why, boxCount: boxes };
    },
    /** What each accuracy takes in this view, and what it gets wrong. */
    judged({ rows }) {
        for (const { accuracy, took, rays, other, lost } of rows) {
            $(`rate-${accuracy}`).textContent = (rays / took / 1000).toFixed(2);
            showPart(`other-${accuracy}`, other, rays);
            showPart(`lost-${accuracy}`, lost, rays);
        }
        last.firstRays = rows.map(({ accuracy, took, ...counts }) => ({ accuracy: ACCURACIES[accuracy], ms: took, ...counts }));
        window.judged = rows;
    },
    measured({ width, height, frames: rows, onGpu }) {
        const row = {
            ...measuring,
            date: new Date().toISOString().slice(0, 10),
            version: about.version,
            instructionSet: about.instructionSet,
            backend: "cpu",
            threads: about.threads,
            browser: navigator.userAgent,
            cores: navigator.hardwareConcurrency ?? null,
            width,
            height,
            frames: rows.map(({ accuracy, took, rays }) => ({ accuracy: ACCURACIES[accuracy], ms: took, rays, raysPerSecond: (1000 * rays) / took })),
        };
        rows.forEach(({ accuracy, took }) => ($(`time-${accuracy}`).textContent = milliseconds(took)));
        if (onGpu !== null) {
            row.gpu = { ...row.gpu, ...onGpu };
            row.parityRow = parityRow(row);
        }
        const name = `splitplane-${row.scene.replace(/[^a-z0-9.-]+/gi, "-")}`;
        if (savesParity && row.parityRow) save(`${name}-parity.md`, `${row.parityRow}\n`, "text/markdown");
        else save(`${name}.json`, `${JSON.stringify(row)}\n`, "application/json");
        window.measured = row;
        say("Measured, and saved.");
        $("measure").disabled = false;
        $("parity").disabled = document.querySelector('input[name="by"][value="gpu"]').disabled;
        draw();
    },
    failed({ text, isDead }) {
        busySince = null;
        complain(text);
        say("There is no picture of that.");
        // Any scene can be chosen then, the one before too.
        if (isReady) $("measure").disabled = false;
        else {
            $("scene").selectedIndex = -1;
            if (chosenBackend() === "gpu") $("gpu").textContent = "";
        }
        if (!isDead) return;
        withGpu = false;
        begin();
    },
};

/** Shows a count as a part of all. */
function showPart(id, count, all) {
    $(id).textContent = count === 0 ? "none" : `${((100 * count) / all).toPrecision(2)} %`;
    $(id).title = `${whole(count)} of ${whole(all)} rays`;
}

function forgetTrade() {
    for (const id of ["rate", "other", "lost"]) for (const number of [0, 1, 2]) $(`${id}-${number}`).textContent = "–";
}

/** Boxes of more nodes, of leaves, and of nothing: by colour, and by how the lines are broken. */
const LINES = [{ colour: "#ffffffb0", dashes: [] }, { colour: "#ffd54acc", dashes: [4, 2] }, { colour: "#6fc3ff90", dashes: [1, 3] }];

/** Draws the edges of boxes over the picture; gives how many boxes there are. */
function drawBoxes(edges) {
    for (const [content, { colour, dashes }] of LINES.entries()) {
        context.beginPath();
        for (let i = 1; i < edges.length; i += 5) {
            if (edges[i + 4] !== content) continue;
            context.moveTo(edges[i], edges[i + 1]);
            context.lineTo(edges[i + 2], edges[i + 3]);
        }
        context.lineWidth = 1;
        context.strokeStyle = colour;
        context.setLineDash(dashes);
        context.stroke();
    }
    return edges[0];
}

/** The browser and the system, as far as they say. */
function machine() {
    const brands = (navigator.userAgentData?.brands ?? []).filter(({ brand }) => !/not.*brand/i.test(brand));
    const browser = brands.length > 0 ? brands.map(({ brand, version }) => `${brand} ${version}`).at(-1) : navigator.userAgent;
    const system = navigator.userAgentData?.platform || (/\(([^;)]+)/.exec(navigator.userAgent)?.[1] ?? "not known");
    return { browser, system };
}

/** A row of the table in docs/parity.md. */
function parityRow({ gpu, digest, scene, triangles, preset, version }) {
    const { browser, system } = machine();
    const isSame = gpu.parity === "bitwise" && gpu.digest === digest && gpu.differ === 0 && gpu.pixelsDiffer === 0;
    const tree = gpu.digest === digest ? "equal" : "NOT equal";
    const cells = [
        `${gpu.adapter}, WebGPU${gpu.isSoftware ? ", software" : ""}`, browser, system, isSame ? "bitwise" : "structural", new Date().toISOString().slice(0, 10),
        `finished tree, against the CPU's digest: ${scene}, ${whole(triangles)} triangles (\`${preset}\`): ${tree}`,
        `${whole(gpu.rays)} first hits, of which ${whole(gpu.differ)} differ, and ${whole(gpu.pixels)} pixels, of which ${whole(gpu.pixelsDiffer)} differ (demonstration page, version ${version})`,
    ];
    return `| ${cells.map((cell) => String(cell).replaceAll("|", "/")).join(" | ")} |`;
}

function save(name, text, type) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/** Which of both files the measurements go to. */
let savesParity = false;

function measure(isParity) {
    savesParity = isParity;
    measuring = structuredClone(last);
    for (const id of ["measure", "parity"]) $(id).disabled = true;
    say("Measuring…");
    worker.postMessage({ do: "measure", job: job() });
}

/** Starts a worker, in the place of one that has ended. */
function begin() {
    worker?.terminate();
    [isReady, hasWorker, busySince] = [false, false, null];
    for (const id of ["scene", "file"]) $(id).disabled = true;
    worker = new Worker(withGpu ? "worker.js?gpu" : "worker.js", { type: "module" });
    worker.onmessage = ({ data }) => {
        // Before the first choice comes whether there is a worker at all.
        if (data.choice === choices || data.choice === 0 || data.isDead) hears[data.kind](data);
    };
    worker.onerror = (event) => {
        complain(`The worker has ended: ${event.message ?? "it could not be loaded"}. Load the page anew.`);
        say("There is no picture.");
    };
}

// Turning and coming nearer.
const pointers = new Map();
let apart = null;

function move(how) {
    if (!isReady) return;
    worker.postMessage({ do: "move", ...how });
    draw();
}

canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    apart = null;
});
canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (before === undefined) return;
    const now = [event.clientX, event.clientY];
    pointers.set(event.pointerId, now);
    if (pointers.size === 1) {
        move({ right: (now[0] - before[0]) / canvas.clientHeight, down: (now[1] - before[1]) / canvas.clientHeight });
    } else if (pointers.size === 2) {
        const [[ax, ay], [bx, by]] = pointers.values();
        const distance = Math.hypot(ax - bx, ay - by);
        if (apart !== null && distance > 0) move({ steps: Math.log2(distance / apart) * 6 });
        apart = distance;
    }
});
for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => {
        pointers.delete(event.pointerId);
        apart = null;
    });
}
canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    move({ steps: -event.deltaY / 60 });
}, { passive: false });

const KEYS = {
    ArrowLeft: { right: -0.05 }, ArrowRight: { right: 0.05 }, ArrowUp: { down: -0.05 }, ArrowDown: { down: 0.05 },
    "+": { steps: 1 }, "=": { steps: 1 }, "-": { steps: -1 }, Home: { home: true },
};
canvas.addEventListener("keydown", (event) => {
    const how = KEYS[event.key];
    if (how === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    move(how);
});

// Settings.
$("settings").addEventListener("submit", (event) => event.preventDefault());
$("scene").addEventListener("change", openBuiltin);
// The same file can be chosen again: it may have been mended.
$("file").addEventListener("click", () => ($("file").value = ""));
$("file").addEventListener("change", () => $("file").files.length > 0 && openFiles($("file").files));
$("preset").addEventListener("change", () => {
    if (opened === null || !hasWorker) return;
    // Also while another tree is built, or after one could not be: the worker does one after the other.
    isReady = false;
    for (const id of ["measure", "parity"]) $(id).disabled = true;
    ask({ do: "build" });
});
$("depth").addEventListener("input", () => {
    $("depth-told").value = $("depth").value;
    draw();
});
$("samples").addEventListener("input", () => {
    const samples = String(2 ** Number($("samples").value));
    $("samples-told").value = samples;
    $("samples").setAttribute("aria-valuetext", samples);
    draw();
});
for (const input of document.querySelectorAll('input[name="backend"]')) input.addEventListener("change", chooseBackend);
$("again").addEventListener("click", () => {
    // The button goes away.
    document.querySelector('input[name="backend"]:checked').focus();
    chooseBackend();
});
const REDRAW = 'input[name="view"], input[name="accuracy"], input[name="by"], #lights, #show-boxes, #judges';
for (const input of document.querySelectorAll(REDRAW)) input.addEventListener("change", draw);
$("boxes").addEventListener("input", () => {
    wantedDepth = Number($("boxes").value);
    $("boxes-told").value = $("boxes").value;
    $("show-boxes").checked = true;
    draw();
});
$("light").addEventListener("change", () => {
    $("samples-are").textContent = $("light").value === "0" ? "Samples a pixel" : "Passes";
    draw();
});
$("home").addEventListener("click", () => move({ home: true }));
$("measure").addEventListener("click", () => measure(false));
$("parity").addEventListener("click", () => measure(true));

// Files that are dropped anywhere.
addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
});
addEventListener("dragleave", () => document.body.classList.remove("dropping"));
addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dropping");
    const { files } = event.dataTransfer;
    if (files.length > 0 && hasWorker) openFiles(files);
});

let waiting = null;
new ResizeObserver(() => {
    clearTimeout(waiting);
    waiting = setTimeout(draw, 150);
}).observe(canvas);

begin();
