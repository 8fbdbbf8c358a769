"use strict";
// plotly is loaded from beside this file once a mechanism comes into sight.
{
  const source = document.currentScript.src.replace(/[^/]*$/, "plotly.min.js");
  let loading = null;
  startViewers(() => {
    loading ??= new Promise((resolve, reject) => {
      const script = document.createElement("script");
      Object.assign(script, { src: source, onload: resolve, onerror: reject });
      document.head.append(script);
    });
    return loading;
  });
}
