// Rays a second on one thread: this package, three-mesh-bvh, and the native library with its portable instruction set, on the same rays
// in turn, with answers compared. In Node: node scripts/speed.mjs [FILE.obj] [RAYS] [ROUNDS]
//
// The native program is target/release/splitplane above; where it is not built (cargo build --release) it is left out.

import { execFileSync } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { cpus, tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

import { BufferAttribute, BufferGeometry, DoubleSide, Ray, Vector3 } from "three";
import { MeshBVH, SAH } from "three-mesh-bvh";

import { Tree, WasmArray, about, init } from "../js/node.js";
import { Numbers, sphere } from "../tests/meshes.mjs";

const [named, count = "200000", rounds = "5"] = process.argv.slice(2);
const file = named || undefined;
const program = fileURLToPath(new URL("../../target/release/splitplane", import.meta.url));

/** Positions and triangles of an OBJ file: of each face the fan around its first corner. */
function read(text) {
    const [positions, indices] = [[], []];
    for (const line of text.split("\n")) {
        const words = line.trim().split(/\s+/);
        if (words[0] === "v") positions.push(...words.slice(1, 4).map(Number));
        if (words[0] !== "f") continue;
        const corners = words.slice(1).map((word) => {
            const number = parseInt(word, 10);
            return number < 0 ? positions.length / 3 + number : number - 1;
        });
        for (let i = 2; i < corners.length; i += 1) indices.push(corners[0], corners[i - 1], corners[i]);
    }
    return { positions: Float32Array.from(positions), indices: Uint32Array.from(indices) };
}

function boundsOf(positions) {
    const [lo, hi] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    positions.forEach((x, i) => {
        lo[i % 3] = Math.min(lo[i % 3], x);
        hi[i % 3] = Math.max(hi[i % 3], x);
    });
    return { lo, hi };
}

/** From a camera, in rows; and from anywhere to anywhere in the box. */
function raySets({ lo, hi }, total) {
    const size = Math.hypot(...hi.map((x, axis) => x - lo[axis]));
    const middle = hi.map((x, axis) => (x + lo[axis]) / 2);
    const width = Math.ceil(Math.sqrt(total));
    const [primary, chords] = [new Float32Array(8 * total), new Float32Array(8 * total)];
    const numbers = new Numbers(3);
    const within = () => numbers.point(1).map((x, axis) => middle[axis] + (x * (hi[axis] - lo[axis])) / 2);
    for (let i = 0; i < total; i += 1) {
        const [x, y] = [(i % width) / width - 0.5, Math.floor(i / width) / width - 0.5];
        const eye = [middle[0] + 0.3 * size, middle[1] + 0.2 * size, middle[2] + 0.9 * size];
        const to = [middle[0] + x * size * 0.8, middle[1] - y * size * 0.8, middle[2]];
        primary.set([...eye, 0, ...to.map((part, axis) => part - eye[axis]), Infinity], 8 * i);
        const [a, b] = [within(), within()];
        chords.set([...a, 0, ...b.map((part, axis) => part - a[axis]), Infinity], 8 * i);
    }
    return { primary, chords };
}

await init();
const mesh = file === undefined ? sphere(150) : read(readFileSync(file, "utf8"));
const { positions, indices } = mesh;
const sets = raySets(boundsOf(positions), Number(count));
const timed = (work) => {
    const since = performance.now();
    work();
    return performance.now() - since;
};
const median = (times) => times.toSorted((a, b) => a - b)[times.length >> 1];

let tree = null;
const own = timed(() => (tree = Tree.build(positions, indices, { preset: "balanced" })));
const geometry = new BufferGeometry();
geometry.setAttribute("position", new BufferAttribute(positions, 3));
geometry.setIndex(new BufferAttribute(indices.slice(), 1));
let bvh = null;
const theirs = timed(() => (bvh = new MeshBVH(geometry, { strategy: SAH, indirect: true })));
console.log(`${file ?? "a sphere"}: ${indices.length / 3} triangles, ${count} rays, median of ${rounds} rounds; ${about().instructionSet}; ${cpus()[0].model}`);
console.log(`build: splitplane ${own.toFixed(0)} ms, three-mesh-bvh (SAH) ${theirs.toFixed(0)} ms; digest ${tree.digest}`);

const folder = mkdtempSync(path.join(tmpdir(), "splitplane-"));
try {
    const hasNative = existsSync(program);
    if (hasNative) {
        const rows = (array, head, add) =>
            Array.from({ length: array.length / 3 }, (_, i) => `${head} ${[0, 1, 2].map((k) => array[3 * i + k] + add).join(" ")}\n`).join("");
        writeFileSync(path.join(folder, "mesh.obj"), rows(positions, "v", 0) + rows(indices, "f", 1));
    } else console.log(`native: left out, there is no ${program}`);
    for (const [name, rays] of Object.entries(sets)) {
        const total = rays.length / 8;
        const [asked, into] = [new WasmArray(rays.length), new WasmArray(4 * total)];
        asked.floats.set(rays);
        const t = new Float32Array(total);
        const ray = new Ray(new Vector3(), new Vector3());
        const lengths = new Float64Array(total);
        const directions = new Float64Array(3 * total);
        for (let i = 0; i < total; i += 1) {
            const direction = rays.subarray(8 * i + 4, 8 * i + 7);
            lengths[i] = Math.hypot(...direction);
            for (let axis = 0; axis < 3; axis += 1) directions[3 * i + axis] = direction[axis] / lengths[i];
        }
        const ways = {
            "splitplane, a batch": () => tree.closestHits(asked, { into }),
            "splitplane, ray by ray": () => {
                for (let i = 0; i < total; i += 1) tree.closestHit(rays.subarray(8 * i, 8 * i + 3), rays.subarray(8 * i + 4, 8 * i + 7));
            },
            "three-mesh-bvh, ray by ray": () => {
                for (let i = 0; i < total; i += 1) {
                    ray.origin.set(rays[8 * i], rays[8 * i + 1], rays[8 * i + 2]);
                    ray.direction.set(directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]);
                    t[i] = (bvh.raycastFirst(ray, DoubleSide)?.distance ?? Infinity) / lengths[i];
                }
            },
        };
        const times = Object.fromEntries(Object.keys(ways).map((way) => [way, []]));
        const native = [];
        const rayFile = path.join(folder, `${name}.f32`);
        // Files of rays have both limits at the end.
        const inFile = rays.map((_, i) => rays[i - (i % 8) + [0, 1, 2, 4, 5, 6, 3, 7][i % 8]]);
        if (hasNative) writeFileSync(rayFile, Buffer.from(inFile.buffer));
        for (let round = 0; round < Number(rounds); round += 1) {
            for (const [way, work] of Object.entries(ways)) times[way].push(timed(work));
            if (!hasNative) continue;
            const ask = ["query", path.join(folder, "mesh.obj"), "--backend", "cpu", "--preset", "balanced", "--rays", rayFile, "--repeat", "3", "--threads", "1", "--json", "--hits", path.join(folder, "hits.raw")];
            const told = execFileSync(program, ask, { env: { ...process.env, SPLITPLANE_ISA: "portable" }, stdio: ["ignore", "pipe", "ignore"] });
            native.push(JSON.parse(told).trace_ms);
        }
        let differ = 0;
        for (let i = 0; i < total; i += 1) {
            const [a, b] = [into.floats[4 * i], t[i]];
            if (!(a === b || Math.abs(a - b) <= 1e-4 * Math.max(1, Math.abs(a)))) differ += 1;
        }
        const rate = (time) => total / time / 1000;
        const batch = median(times["splitplane, a batch"]);
        console.log(`${name}:`);
        for (const [way, all] of Object.entries(times)) console.log(`  ${way}: ${rate(median(all)).toFixed(3)} million rays/s`);
        console.log(`  a batch over three-mesh-bvh: ${(median(times["three-mesh-bvh, ray by ray"]) / batch).toFixed(2)}; rays that differ: ${differ} of ${total}`);
        if (hasNative) {
            const hits = readFileSync(path.join(folder, "hits.raw"));
            const equal = Buffer.compare(hits, Buffer.from(into.bytes)) === 0;
            console.log(`  native, portable: ${rate(median(native)).toFixed(3)} million rays/s; a batch over it: ${(median(native) / batch).toFixed(2)}; hits are ${equal ? "" : "NOT "}equal, byte for byte`);
        }
        asked.free();
        into.free();
    }
} finally {
    rmSync(folder, { recursive: true });
}
