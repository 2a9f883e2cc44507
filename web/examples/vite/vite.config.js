// What isolates a page, so that its workers may share memory (threads.html).
const headers = { "Cross-Origin-Opener-Policy": "same-origin", "Cross-Origin-Embedder-Policy": "require-corp" };

// The package finds its .wasm files beside itself: the development server must leave it as it is.
export default {
    build: { target: "es2022", rollupOptions: { input: ["index.html", "threads.html"] } },
    // The package and this program are to have the same three.js, also where the package is a link to a folder with one of its own.
    resolve: { dedupe: ["three"] },
    optimizeDeps: { exclude: ["splitplane"] },
    // Workers that load parts when they are asked for are modules.
    worker: { format: "es" },
    // The package is not in this folder: the server has to be allowed to give its .wasm files.
    server: { headers, fs: { allow: ["../.."] } },
    preview: { headers },
};
