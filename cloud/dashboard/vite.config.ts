import { defineConfig } from "vite";

// The pages are served under `Content-Security-Policy: default-src 'self'`, which forbids data: addresses
// (assetsInlineLimit) and inline scripts (modulePreload's polyfill).
export default defineConfig({
  base: "/",
  build: {
    outDir: "../eskin_cloud/dashboard", // a part of the Python package
    emptyOutDir: true,
    target: "es2022",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    cssCodeSplit: false,
    reportCompressedSize: true,
  },
});
