document.getElementById("subtitle").textContent = DATA.subtitle;
({ design: designPage, compare: comparePage, estimate: estimatePage, calibrate: calibratePage })[
  DATA.kind
](DATA.content);
document.documentElement.dataset.ready = "true";
