// The package finds its .wasm files beside itself: the development server must leave it as it is.
export default {
    build: { target: "es2022" },
    optimizeDeps: { exclude: ["splitplane"] },
};
