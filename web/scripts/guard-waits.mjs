// guard-waits.mjs FILE: gives each function of a module that waits for others one local more, unused, in place.
//
// V8 11.3, which Node 20 has, compiles memory.atomic.wait32 so that 8 bytes go to a place of 4: the address that is waited at. That clears
// the local before it, the last one of the function, if that is on the stack. (Its first compiler, Liftoff, does; code that is compiled
// once more is right.) Two workers that had waited for their parts of the pool then wrote them to one address, and started the same one.
// So the last local is one that nobody reads. Run this last: optimisers remove it.

import { readFileSync, writeFileSync } from "node:fs";

const CODE = 10;
const I32 = 0x7f;
/** memory.atomic.wait32 and wait64, each with the alignment that it must have. Constants that look like one do no harm. */
const WAITS = [
    [0xfe, 0x01, 0x02],
    [0xfe, 0x02, 0x03],
];

function unsigned(bytes, at) {
    let [value, shift] = [0, 0];
    for (;;) {
        const byte = bytes[at++];
        value += (byte & 0x7f) * 2 ** shift;
        if (byte < 0x80) return [value, at];
        shift += 7;
    }
}

function encoded(value) {
    const out = [];
    do {
        const low = value % 128;
        value = Math.floor(value / 128);
        out.push(value > 0 ? low + 128 : low);
    } while (value > 0);
    return out;
}

const waits = (body) => WAITS.some((code) => body.includes(Buffer.from(code)));

/** The body of a function, with a local more at its end. */
function guarded(body) {
    const [groups, at] = unsigned(body, 0);
    let end = at;
    for (let i = 0; i < groups; i += 1) end = unsigned(body, end)[1] + 1;
    return Buffer.concat([Buffer.from(encoded(groups + 1)), body.subarray(at, end), Buffer.from([1, I32]), body.subarray(end)]);
}

function guardedCode(section) {
    let [count, at] = unsigned(section, 0);
    const out = [Buffer.from(encoded(count))];
    let found = 0;
    for (; count > 0; count -= 1) {
        const [length, start] = unsigned(section, at);
        at = start + length;
        let body = section.subarray(start, at);
        if (waits(body)) {
            body = guarded(body);
            found += 1;
        }
        out.push(Buffer.from(encoded(body.length)), body);
    }
    return [Buffer.concat(out), found];
}

const file = process.argv[2];
const module = readFileSync(file);
const out = [module.subarray(0, 8)];
let found = 0;
for (let at = 8; at < module.length; ) {
    const id = module[at];
    const [length, start] = unsigned(module, at + 1);
    at = start + length;
    let section = module.subarray(start, at);
    if (id === CODE) [section, found] = guardedCode(section);
    out.push(Buffer.from([id, ...encoded(section.length)]), section);
}
if (found === 0) throw new Error(`${file}: no function waits for others`);
writeFileSync(file, Buffer.concat(out));
