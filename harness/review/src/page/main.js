// The start. `karat` is what data files call, and what a console may ask.

window.karat = { receive, state, numbers, tones, change, stage, failing, histogram, loaded, keys };
address.follow();
if (selectedCase()) load(selectedCase());
change();
