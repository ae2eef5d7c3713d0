// What the tab keeps until it is closed; where the browser lets it keep nothing, until the page is left.

const here = new Map();

export function keep(name, text) {
  here.set(name, text);
  try {
    sessionStorage.setItem(name, text);
  } catch {
    // site data may be switched off, which even a look at them throws
  }
}

/** The text that was kept; null where there is none. */
export function kept(name) {
  try {
    return here.get(name) ?? sessionStorage.getItem(name); // which may be full, and hold what was before
  } catch {
    return null;
  }
}
