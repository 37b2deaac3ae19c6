// The start of the page. Data files call `karat`, and you can call it in a console.

window.karat = { receive, state, numbers, tones, change, stage, failing, histogram, loaded, keys };
address.follow();
if (selectedCase()) load(selectedCase());
change();
