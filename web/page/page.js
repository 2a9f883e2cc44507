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

const milliseconds = (time) => (time < 10_000 ? `${time.toFixed(time < 10 ? 1 : 0)} ms` : `${(time / 1000).toFixed(1)} s`);
const whole = (number) => number.toLocaleString("en");

function say(text) {
    $("status").textContent = text;
}

function complain(text) {
    $("error").hidden = text === null;
    $("error").textContent = text ?? "";
    window.problem = text;
}

function chosen(name) {
    return Number(document.querySelector(`input[name="${name}"]:checked`).value);
}

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
    };
}

function draw() {
    if (isReady) worker.postMessage({ do: "draw", job: job() });
}

function open(what) {
    complain(null);
    isReady = false;
    $("measure").disabled = true;
    opened = what;
    say(`Opening ${what.name}…`);
    worker.postMessage({ do: "open", ...what, preset: $("preset").value, aspect: 1.6 });
}

async function openFile(file) {
    complain(null);
    if (file.size > about.mostBytes) {
        complain(`${file.name} has ${whole(file.size)} bytes; ${whole(about.mostBytes)} are the most that this page reads.`);
        return;
    }
    try {
        say(`Reading ${file.name}…`);
        open({ file: await file.arrayBuffer(), name: file.name });
    } catch (error) {
        complain(`${file.name} cannot be read: ${error.message}`);
    }
}

function openBuiltin() {
    const name = $("scene").value;
    $("file").value = "";
    open({ builtin: name, name });
}

/** Has the tree built on the GPU too, or no longer. */
function chooseBackend() {
    const isOn = document.querySelector('input[name="backend"]:checked').value === "gpu";
    for (const id of ["gpu-built", "gpu-digest"]) $(id).textContent = "–";
    $("gpu").textContent = isOn ? "Looking for a GPU…" : "";
    delete window.onGpu;
    worker.postMessage({ do: "gpu", isOn, preset: $("preset").value });
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
        if (state === "failed") $("gpu").textContent = `No tree by the GPU: ${text}. The CPU does the work.`;
        if (state === "built" || state === "failed") window.onGpu = { state, text, adapter, parity, digest };
    },
    ready({ scenes, mostBytes, version, instructionSet }) {
        about = { mostBytes, version, instructionSet };
        if ($("scene").options.length === 0) {
            for (const { name, shows } of scenes) $("scene").add(new Option(`${name}: ${shows.split(";")[0]}`, name));
            const asked = new URLSearchParams(location.search).get("scene");
            $("scene").value = scenes.some(({ name }) => name === asked) ? asked : "gallery";
        }
        if (!("gpu" in navigator)) $("gpu").textContent = "Your browser has no WebGPU here: the CPU does the work.";
        $("by").textContent = `the CPU, one thread, ${instructionSet}`;
        document.querySelector('input[name="backend"][value="cpu"]').checked = true;
        for (const id of ["scene", "file"]) $(id).disabled = false;
        if (opened === null) openBuiltin();
        else say("Choose another scene.");
    },
    opened({ name, took, triangles, notes }) {
        $("triangles").textContent = whole(triangles);
        $("read").textContent = milliseconds(took);
        say(`Building the tree of ${name}…${notes.length > 0 ? ` (${notes.join("; ")})` : ""}`);
        last = { scene: name, triangles, readMs: took };
    },
    progress({ stage, done, total }) {
        say(`Building the tree: ${stage}${total > 0 ? `, ${Math.round((100 * done) / total)} %` : ""}`);
    },
    built({ preset, took, digest, nodes, references, bytes }) {
        $("built").textContent = milliseconds(took);
        $("digest").textContent = digest;
        for (const id of ["gpu-built", "gpu-digest"]) $(id).textContent = "–";
        delete last.gpu;
        delete window.onGpu;
        for (const number of [0, 1, 2]) $(`time-${number}`).textContent = "";
        Object.assign(last, { preset, buildMs: took, digest, nodes, references, queryBytes: bytes });
        isReady = true;
        $("measure").disabled = false;
        draw();
    },
    picture({ width, height, samples, pixels, took, paths, shadows, top, isLast, job }) {
        [small.width, small.height] = [width, height];
        small.getContext("2d").putImageData(new ImageData(new Uint8ClampedArray(pixels), width, height), 0, 0);
        if (canvas.width !== job.width || canvas.height !== job.height) [canvas.width, canvas.height] = [job.width, job.height];
        context.imageSmoothingEnabled = width === job.width;
        context.drawImage(small, 0, 0, job.width, job.height);
        window.firstPicture ??= performance.now();
        if (width !== job.width) return;
        const rays = paths + shadows;
        if (samples === 1 && job.view === 0) {
            $("frame").textContent = `${milliseconds(took)}, ${width} × ${height}`;
            $("rate").textContent = `${(rays / took / 1000).toFixed(2)} million`;
            $(`time-${job.accuracy}`).textContent = milliseconds(took);
        }
        if (!isLast) return;
        const heat = `what the first ray of each pixel cost, from dark to white: ${whole(top)} nodes and triangles or more`;
        const shows = job.view === 1 ? heat : `${samples === 1 ? "one sample" : `${samples} samples`} a pixel, ${ACCURACIES[job.accuracy]}`;
        say(`${last.scene}: ${shows}`);
        canvas.setAttribute("aria-label", `${last.scene}, ${whole(last.triangles)} triangles; ${shows}`);
        window.shown = { ...last, ...job, took, rays };
    },
    measured({ width, height, rows }) {
        const row = {
            ...last,
            date: new Date().toISOString().slice(0, 10),
            version: about.version,
            instructionSet: about.instructionSet,
            backend: "cpu",
            threads: 1,
            browser: navigator.userAgent,
            cores: navigator.hardwareConcurrency ?? null,
            width,
            height,
            frames: rows.map(({ accuracy, took, rays }) => ({ accuracy: ACCURACIES[accuracy], ms: took, rays, raysPerSecond: (1000 * rays) / took })),
        };
        rows.forEach(({ accuracy, took }) => ($(`time-${accuracy}`).textContent = milliseconds(took)));
        const link = document.createElement("a");
        link.href = URL.createObjectURL(new Blob([`${JSON.stringify(row)}\n`], { type: "application/json" }));
        link.download = `splitplane-${last.scene.replace(/[^a-z0-9.-]+/gi, "-")}.json`;
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
        window.measured = row;
        say("Measured, and saved.");
        $("measure").disabled = false;
        draw();
    },
    failed({ text, isDead }) {
        complain(text);
        say("There is no picture of that.");
        if (isDead) begin();
    },
};

/** Starts a worker, in the place of one that has ended. */
function begin() {
    worker?.terminate();
    isReady = false;
    worker = new Worker("worker.js", { type: "module" });
    worker.onmessage = ({ data }) => hears[data.kind](data);
    worker.onerror = (event) => complain(`The worker has ended: ${event.message ?? "it could not be loaded"}`);
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
$("file").addEventListener("change", () => $("file").files.length > 0 && openFile($("file").files[0]));
$("preset").addEventListener("change", () => {
    if (!isReady) return;
    isReady = false;
    worker.postMessage({ do: "build", preset: $("preset").value, aspect: 1.6 });
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
for (const input of document.querySelectorAll('input[name="view"], input[name="accuracy"], #lights')) input.addEventListener("change", draw);
$("home").addEventListener("click", () => move({ home: true }));
$("measure").addEventListener("click", () => {
    $("measure").disabled = true;
    say("Measuring…");
    worker.postMessage({ do: "measure", job: job() });
});

// Files that are dropped anywhere.
addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dropping");
});
addEventListener("dragleave", () => document.body.classList.remove("dropping"));
addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dropping");
    const [file] = event.dataTransfer.files;
    if (file !== undefined && about !== null) openFile(file);
});

let waiting = null;
new ResizeObserver(() => {
    clearTimeout(waiting);
    waiting = setTimeout(draw, 150);
}).observe(canvas);

begin();
