// `npm run lint` in this folder. Only rules that find mistakes, and no package beside eslint.

const globals = (names) => Object.fromEntries(names.split(" ").map((name) => [name, "readonly"]));
const rules = {
  "consistent-return": "error", "eqeqeq": "error", "no-const-assign": "error", "no-dupe-keys": "error", "no-fallthrough": "error",
  "no-redeclare": "error", "no-self-assign": "error", "no-shadow-restricted-names": "error", "no-undef": "error",
  "no-unreachable": "error", "no-unused-vars": "error", "no-use-before-define": ["error", { functions: false, variables: false }],
  "no-var": "error", "prefer-const": "error", "max-len": ["error", { code: 140, ignoreStrings: true, ignoreTemplateLiterals: true }],
};
const everywhere = "Blob DecompressionStream Response TextDecoder URL URLSearchParams atob clearTimeout console crypto performance setTimeout";
const page = "CanvasRenderingContext2D Event File ImageData MediaRecorder Option ResizeObserver Worker createImageBitmap document fetch history " +
  "location matchMedia navigator requestAnimationFrame window";
const worker = "caches clients fetch ort registration self";

export default [
  { linterOptions: { reportUnusedDisableDirectives: true }, rules, languageOptions: { globals: globals(everywhere) } },
  { files: ["page/*.js", "studio/*.js"], languageOptions: { globals: globals(page) } },
  { files: ["studio/worker.js", "studio/sw.js"], languageOptions: { globals: globals(worker) } },
];
