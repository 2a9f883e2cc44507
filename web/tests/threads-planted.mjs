// Loaded before all else, this plants a fault in worker threads: their compiled part fails when it first asks for the time, which it does to tell
// of progress.

import { isMainThread } from "node:worker_threads";

if (!isMainThread) {
    Date.now = () => {
        throw new Error("planted");
    };
}
