/* What a page owes everybody, checked inside it: names, structure, contrast. */
({
  /** Controls that a screen reader could not name. */
  withoutName: () => [...document.querySelectorAll('a, button, input, select, iframe, img, [role=region], dialog')]
    .filter(node => {
      const by = (node.getAttribute('aria-labelledby') ?? '').split(' ').map(id => document.getElementById(id)?.textContent ?? '').join('');
      const labels = [...(node.labels ?? [])].map(label => label.textContent).join('');
      const name = node.getAttribute('aria-label') || by || labels || node.textContent || node.getAttribute('title') ||
        (node.tagName === 'IMG' && (node.alt || node.hasAttribute('alt')) ? 'image' : '');
      return !name.trim() && !node.closest('[hidden]');
    }).map(node => node.outerHTML.slice(0, 120)),
  /** What is wrong with ids, headings and frames. */
  structure: () => {
    const ids = [...document.querySelectorAll('[id]')].map(n => n.id), levels = [...document.querySelectorAll('h1, h2, h3')].map(n => +n.tagName[1]);
    const wrong = [];
    if (new Set(ids).size !== ids.length) wrong.push('ids twice: ' + ids.filter((id, i) => ids.indexOf(id) !== i));
    if (levels.filter(l => l === 1).length !== 1) wrong.push('h1: ' + levels.filter(l => l === 1).length);
    levels.forEach((l, i) => { if (i && l > levels[i - 1] + 1) wrong.push('a heading level is left out'); });
    for (const node of document.querySelectorAll('[aria-describedby]'))
      for (const id of node.getAttribute('aria-describedby').split(' ')) if (!document.getElementById(id)) wrong.push('no ' + id);
    for (const node of document.querySelectorAll('[tabindex]')) if (node.tabIndex > 0) wrong.push('tabindex');
    for (const node of document.querySelectorAll('iframe')) if (node.sandbox.contains('allow-same-origin')) wrong.push('frame');
    if (!document.documentElement.lang) wrong.push('lang');
    return wrong;
  },
  /** Texts below the contrast of WCAG 2 AA: 4.5, or 3 where they are large. */
  contrast: () => {
    const pen = Object.assign(document.createElement('canvas'), { width: 1, height: 1 }).getContext('2d', { willReadFrequently: true });
    const rgba = (color) => { pen.clearRect(0, 0, 1, 1); pen.fillStyle = color; pen.fillRect(0, 0, 1, 1);
      const [r, g, b, a] = pen.getImageData(0, 0, 1, 1).data; return [r, g, b, a / 255]; };
    const over = (top, base) => [0, 1, 2].map(i => top[i] * top[3] + base[i] * (1 - top[3]));
    const light = (c) => { const [r, g, b] = c.map(v => { v /= 255; return v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4; });
      return .2126 * r + .7152 * g + .0722 * b; };
    const behind = (node) => { const layers = [];
      for (let at = node; at; at = at.parentElement) { const c = rgba(getComputedStyle(at).backgroundColor); layers.push(c); if (c[3] > .999) break; }
      return layers.reverse().reduce((base, top) => over(top, base), [255, 255, 255]); };
    const low = [];
    for (const node of document.querySelectorAll('body *')) {
      const own = [...node.childNodes].some(n => n.nodeType === 3 && n.data.trim());
      const box = node.getBoundingClientRect();
      if (!own || !box.width || !box.height || box.bottom < 0 || box.right < 0 || node.closest('[disabled], [hidden], .sr, option, .skip')) continue;
      const style = getComputedStyle(node), back = behind(node), front = over(rgba(style.color), back);
      const [a, b] = [light(front), light(back)].sort((x, y) => y - x), ratio = (a + .05) / (b + .05);
      const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && +style.fontWeight >= 700);
      if (ratio < (large ? 3 : 4.5)) low.push(`${ratio.toFixed(2)} ${node.className} ${node.textContent.trim().slice(0, 30)}`);
    }
    return low;
  },
  /** Whether the focus can be seen. */
  focusShown: () => {
    const at = document.activeElement, near = at.closest(".drop, .choice");
    return [at, near].some((node) => node && getComputedStyle(node).outlineStyle !== "none");
  },
})
