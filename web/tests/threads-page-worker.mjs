// A thread of the page's compiled part, in a worker of Node.

import { parentPort } from "node:worker_threads";

import { runThread } from "../js/pool.js";
import * as raw from "../target/page/pkg/threads/splitplane_threads.js";

parentPort.once("message", (told) => runThread(raw, told, (answer) => parentPort.postMessage(answer)));
