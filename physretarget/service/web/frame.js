// Pages that a job made, in frames that can run their own scripts and reach nothing else.

import { alarm, el } from "./dom.js";
import { openable, token } from "./api.js";

/** A frame of one of the server's pages; `seek(seconds)` of a replay moves its clock. */
export function frame(path, title, classes = "") {
  const inner = el("iframe", {
    title, sandbox: "allow-scripts allow-downloads", allow: "fullscreen", referrerpolicy: "no-referrer",
  });
  const box = el("div", { class: `framed ${classes}`, "aria-busy": "true" }, inner);
  inner.addEventListener("load", () => box.removeAttribute("aria-busy"));
  openable(path).then((url) => inner.setAttribute("src", url),
    (error) => box.replaceChildren(alarm("This cannot be shown.", error.message)));
  // The frame has an origin of its own that has no name, so "*"; what is told is no secret.
  return { box, seek: (seconds) => inner.contentWindow?.postMessage({ physretarget: "seek", seconds }, "*") };
}

/** A link that opens or downloads something that may need a ticket. */
export function opening(path, name, properties, ...children) {
  const link = el("a", { href: path, ...properties, ...(name ? { download: name } : { target: "_blank", rel: "noopener" }) },
    ...children);
  link.addEventListener("click", async (event) => {
    if (!token.get() || link.dataset.ready) { delete link.dataset.ready; return; }
    event.preventDefault();
    const shown = name ? null : open("about:blank", "_blank"); // now, or it counts as a pop-up
    try {
      const url = await openable(path);
      if (shown) { shown.opener = null; shown.location = new URL(url, location.href); return; }
      link.dataset.ready = "yes";
      link.href = url;
      link.click();
      link.href = path;
    } catch (error) {
      shown?.close();
      link.after(alarm("That did not work.", error.message));
    }
  });
  return link;
}
