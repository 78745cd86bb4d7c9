export type Theme = "light" | "dark";

const KEY = "eskin.theme";

function stored(): Theme | null {
  try {
    const value = localStorage.getItem(KEY);
    return value === "light" || value === "dark" ? value : null;
  } catch (error) {
    // Storage may be switched off; the theme then follows the system.
    if (error instanceof DOMException) return null;
    throw error;
  }
}

/** Light or dark: the system's setting until the user chooses; the choice is kept. */
export class ThemeChoice {
  private chosen = stored();
  private readonly system = matchMedia("(prefers-color-scheme: dark)");

  constructor(
    private readonly root: HTMLElement,
    private readonly onChange: () => void,
  ) {
    this.system.addEventListener("change", () => this.apply());
    this.apply();
  }

  get theme(): Theme {
    return this.chosen ?? (this.system.matches ? "dark" : "light");
  }

  toggle(): void {
    this.chosen = this.theme === "dark" ? "light" : "dark";
    try {
      localStorage.setItem(KEY, this.chosen);
    } catch (error) {
      if (!(error instanceof DOMException)) throw error;
    }
    this.apply();
  }

  private apply(): void {
    this.root.dataset["theme"] = this.theme;
    this.onChange();
  }
}
