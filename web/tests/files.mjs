// Files of scenes, made here.

import { closeSync, openSync, writeSync } from "node:fs";

/** A number of triangles as a binary STL file. */
export function stl(triangles) {
    const bytes = Buffer.alloc(84 + 50 * triangles.length);
    bytes.writeUInt32LE(triangles.length, 80);
    triangles.forEach((corners, place) => corners.flat().forEach((x, k) => bytes.writeFloatLE(x, 84 + 50 * place + 12 + 4 * k)));
    return bytes;
}

/** Writes hills of `side` times `side` squares as a binary STL file; gives the number of triangles. */
export function hills(path, side) {
    const height = (x, y) => 20 * Math.sin(x * 0.013) * Math.cos(y * 0.017) + Math.sin(x * 1.7 + y * y * 0.01);
    const squares = [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]];
    const file = openSync(path, "w");
    const head = Buffer.alloc(84);
    head.writeUInt32LE(2 * side * side, 80);
    writeSync(file, head);
    for (let y = 0; y < side; y += 1) {
        const row = Buffer.alloc(100 * side);
        let at = 0;
        for (let x = 0; x < side; x += 1) {
            for (const triangle of squares) {
                at += 12;
                for (const [right, up] of triangle) {
                    for (const number of [x + right, y + up, height(x + right, y + up)]) at = row.writeFloatLE(number, at);
                }
                at += 2;
            }
        }
        writeSync(file, row);
    }
    closeSync(file);
    return 2 * side * side;
}

const chunk = (type, bytes, fill) => {
    const padded = Buffer.concat([bytes, Buffer.alloc((4 - (bytes.length % 4)) % 4, fill)]);
    const head = Buffer.alloc(8);
    head.writeUInt32LE(padded.length, 0);
    head.write(type, 4, "latin1");
    return Buffer.concat([head, padded]);
};

/** A square, twice as instances at places of their own, before a camera and under a light: as JSON, and the bytes of its buffer. */
export function gltf() {
    const corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]];
    const bin = Buffer.alloc(48 + 12);
    corners.flat().forEach((x, place) => bin.writeFloatLE(x, 4 * place));
    [0, 1, 2, 0, 2, 3].forEach((index, place) => bin.writeUInt16LE(index, 48 + 2 * place));
    const root = {
        asset: { version: "2.0" },
        extensionsUsed: ["KHR_lights_punctual"],
        extensions: { KHR_lights_punctual: { lights: [{ type: "point", color: [1, 1, 1], intensity: 30 }] } },
        scene: 0,
        scenes: [{ nodes: [0, 1, 2, 3] }],
        nodes: [
            { mesh: 0, translation: [-1.5, 0, 0] },
            { mesh: 0, translation: [1.5, 0, 0], scale: [1, 0.5, 1] },
            { camera: 0, translation: [0, 0, 6] },
            { translation: [0, 2, 3], extensions: { KHR_lights_punctual: { light: 0 } } },
        ],
        cameras: [{ type: "perspective", perspective: { yfov: 0.9, znear: 0.1 } }],
        materials: [{ pbrMetallicRoughness: { baseColorFactor: [1, 0.05, 0.05, 1], metallicFactor: 0 } }],
        meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1, material: 0 }] }],
        accessors: [
            { bufferView: 0, componentType: 5126, count: 4, type: "VEC3", min: [-1, -1, 0], max: [1, 1, 0] },
            { bufferView: 1, componentType: 5123, count: 6, type: "SCALAR" },
        ],
        bufferViews: [{ buffer: 0, byteLength: 48 }, { buffer: 0, byteOffset: 48, byteLength: 12 }],
        buffers: [{ byteLength: 60 }],
    };
    return { root, bin };
}

/** The same as one file. */
export function glb() {
    const { root, bin } = gltf();
    const all = [chunk("JSON", Buffer.from(JSON.stringify(root)), 0x20), chunk("BIN\0", bin, 0)];
    const head = Buffer.alloc(12);
    head.write("glTF", 0, "latin1");
    head.writeUInt32LE(2, 4);
    head.writeUInt32LE(12 + all[0].length + all[1].length, 8);
    return Buffer.concat([head, ...all]);
}
