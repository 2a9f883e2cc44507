// A thread of the package, in a browser's worker.

import * as raw from "../pkg/threads/splitplane_threads.js";
import { runThread } from "./pool.js";

onmessage = ({ data }) => runThread(raw, data, (told) => postMessage(told));
