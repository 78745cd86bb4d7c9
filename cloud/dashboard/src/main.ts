import "uplot/dist/uPlot.min.css";
import "./style/tokens.css";
import "./style/layout.css";
import "./style/chart.css";
import "./style/parts.css";
import "./style/skin-view.css";
import "./style/times.css";
import { Client } from "./api/client";
import { Palette } from "./chart/palette";
import { ThemeChoice } from "./state/theme";
import { Timeline } from "./time/timeline";
import { App } from "./view/app";

let leaving = false;

/** Goes to the login, once: several requests may be refused at a time. */
function toLogin(): void {
  if (leaving) return;
  leaving = true;
  // The login comes back to the same view, which the hash names.
  location.assign(`/login${location.hash}`);
}

// The browser's way back may show this very page once more, which must then be able to leave again.
addEventListener("pageshow", () => {
  leaving = false;
});

function start(root: HTMLElement): void {
  const client = new Client({ fetch: (input, init) => fetch(input, init), onUnauthorised: toLogin });
  const timeline = new Timeline(BigInt(Math.floor(Date.now() / 1000)) * 1_000_000_000n);
  const palette = new Palette(document.documentElement);
  const app = new App({ root, client, timeline, palette, theme: () => theme, onUnauthorised: toLogin });
  const theme = new ThemeChoice(document.documentElement, () => {
    palette.refresh();
    app.repaint();
  });
  app.start();
}

const root = document.getElementById("app");
if (root === null) throw new Error('the page has no element with the id "app"');
start(root);
