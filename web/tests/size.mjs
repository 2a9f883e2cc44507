// How many bytes a visitor loads, compressed as servers do it; refuses more than is promised.

import { existsSync, readFileSync } from "node:fs";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";

const limits = [
    ["queries alone", ["../pkg/splitplane_bg.wasm"], 400_000],
    ["WebGPU, when it is asked for", ["../pkg/gpu/splitplane_gpu_bg.wasm"], 400_000],
    ["queries alone, on threads", ["../pkg/threads/splitplane_threads_bg.wasm"], 400_000],
    ["the demonstration page, with WebGPU", ["../target/page/pkg/splitplane_bg.wasm"], 1_500_000],
    ["the demonstration page where it is isolated, until WebGPU is asked for", ["../target/page/pkg/threads/splitplane_threads_bg.wasm"], 1_500_000],
];
let refused = false;
for (const [what, paths, limit] of limits) {
    const urls = paths.map((path) => new URL(path, import.meta.url));
    // Only parts for threads can be left out, by build.sh.
    if (paths.some((path) => /threads/.test(path)) && !urls.every((url) => existsSync(url))) continue;
    const bytes = Buffer.concat(urls.map((url) => readFileSync(url)));
    const brotli = brotliCompressSync(bytes, { params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_LGWIN]: 24 } }).length;
    const gzip = gzipSync(bytes, { level: 9 }).length;
    const told = `${bytes.length} bytes, ${gzip} by gzip, ${brotli} by Brotli`;
    console.log(`${what}: ${told}; at most ${limit} by Brotli are allowed`);
    refused ||= brotli > limit;
}
process.exit(refused ? 1 : 0);
