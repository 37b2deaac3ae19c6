// The script of `karat browser`'s page, after the text of `jobs.js`. Each request of the page sends the last reply, and
// asks for the next job.

const page = crypto.randomUUID();
const show = (text) => { document.querySelector('p').textContent = text; };
const body = (said) => JSON.stringify({ page, ...said });

async function work() {
    if (!navigator.gpu) throw new Error('this browser has no WebGPU');
    const { device, greeting } = await opened(navigator.gpu, 'Browser');
    const version = navigator.userAgent.match(/(Firefox|Edg|Chrome|Version)\/[\d.]+/)?.[0] ?? navigator.userAgent;
    // Reloads the page to get a new device.
    device.lost.then(() => location.reload());
    addEventListener('pagehide', () => navigator.sendBeacon('next', body({ closed: true })));
    show('Karat runs its tests here. Leave this page open.');
    let said = { greeting: JSON.stringify({ ...greeting, driver: version.replace('/', ' ') }) };
    for (;;) {
        const next = await fetch('next', { method: 'POST', body: body(said) });
        said = {};
        if (next.status === 204) continue;
        if (!next.ok) return show(await next.text());
        const { number, job } = await next.json();
        said = { number, answer: JSON.stringify(await answered(device, JSON.parse(job))) };
    }
}

work().catch((error) => {
    const failed = String(error?.message ?? error);
    show(error instanceof TypeError ? 'The tests have ended.' : failed);
    navigator.sendBeacon('next', body({ failed }));
});
