// Rays on all cores: the work is in threads-worker.js, since a window's own thread cannot wait for others.

const told = document.getElementById("told");
const worker = new Worker(new URL("./threads-worker.js", import.meta.url), { type: "module" });
worker.onmessage = ({ data: { threads, why, digest, found, took } }) => {
    const how = threads > 1 ? `${threads} threads` : `one thread, since ${why}`;
    told.textContent = `${found.toLocaleString("en")} of a million rays hit, in ${took.toFixed(0)} ms on ${how}; digest ${digest}`;
};
worker.onerror = ({ message }) => (told.textContent = `The worker has ended: ${message}`);
