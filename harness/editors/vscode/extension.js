// Starts `karat lsp`, and shows the review in a panel. What is found is the server's: docs/editors.md.
"use strict";

const { spawn } = require("node:child_process");
const fs = require("node:fs");
const path = require("node:path");
const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

/** @type {LanguageClient | undefined} */
let client;

/** The servers of open reviews. */
const reviews = new Set();

/** The folder that a command is about: that of the text in front or, without one, the first that is open. */
function folder() {
  const text = vscode.window.activeTextEditor?.document.uri;
  const own = text && vscode.workspace.getWorkspaceFolder(text);
  return (own ?? vscode.workspace.workspaceFolders?.[0])?.uri.fsPath;
}

/** The program: what the settings say, what npm installed in the folder, or what PATH has. */
function program() {
  const set = vscode.workspace.getConfiguration("karat").get("command");
  if (set) return set;
  const name = process.platform === "win32" ? "karat.cmd" : "karat";
  const installed = path.join(folder() ?? "", "node_modules", ".bin", name);
  return fs.existsSync(installed) ? installed : "karat";
}

/** How the program is started. Windows runs what npm installs through its shell alone. */
function options() {
  return { cwd: folder(), shell: process.platform === "win32" };
}

/** An error, with a way to the setting that mends it. */
async function say(message) {
  const settings = "Open Settings";
  if ((await vscode.window.showErrorMessage(message, settings)) === settings) {
    await vscode.commands.executeCommand("workbench.action.openSettings", "karat.command");
  }
}

async function start() {
  const paths = vscode.workspace.getConfiguration("karat").get("paths").join(",");
  const run = { command: program(), args: ["lsp", ...(paths ? ["--paths", paths] : [])], options: options() };
  const documentSelector = ["wgsl", "wesl"].map((language) => ({ scheme: "file", language }));
  client = new LanguageClient("karat", "Karat", run, { documentSelector });
  try {
    await client.start();
  } catch (error) {
    await say(`\`${run.command} lsp\` doesn't start: ${error.message ?? error}`);
  }
}

async function stop() {
  const last = client;
  client = undefined;
  // One that never started can't be stopped, and needn't be.
  await last?.dispose().catch(() => {});
}

/** `karat test` in a terminal: its colours, links and progress are made for one. The server hears when it ends. */
async function test() {
  const execution = new vscode.ShellExecution(program(), ["test"], { cwd: folder() });
  const scope = vscode.workspace.workspaceFolders?.[0] ?? vscode.TaskScope.Workspace;
  await vscode.tasks.executeTask(new vscode.Task({ type: "karat" }, scope, "test", "karat", execution));
}

/** `karat review` in a panel, for as long as that is open. */
function review() {
  const server = spawn(program(), ["review"], { ...options(), stdio: ["ignore", "pipe", "pipe"] });
  reviews.add(server);
  let panel;
  let out = "";
  let err = "";
  server.on("error", (error) => (err = `it doesn't start: ${error.message}`));
  server.stderr.on("data", (data) => (err += data));
  server.stdout.on("data", async (data) => {
    out += data;
    const url = out.match(/^http:\/\/127\.0\.0\.1:\d+\/\w+\/$/m)?.[0];
    if (!url || panel) return;
    panel = vscode.window.createWebviewPanel("karat.review", "Karat: Review", vscode.ViewColumn.Active, {
      enableScripts: true, // those of the review: a frame may do no more than what is around it
      retainContextWhenHidden: true,
    });
    panel.onDidDispose(() => server.kill("SIGINT"));
    panel.webview.html = page(url);
  });
  server.on("close", (code) => {
    reviews.delete(server);
    if (panel) return panel.dispose();
    // Without a page it has said why: that nothing is pending, or what is wrong.
    const said = (err.trim() || out.trim() || `it ended with ${code}`).split("\n")[0];
    if (code === 0) vscode.window.showInformationMessage(`Karat: ${said}`);
    else if (code !== null) say(`\`karat review\`: ${said}`);
  });
}

/** A page that holds another one, and may hold nothing else. */
function page(url) {
  const policy = `default-src 'none'; style-src 'unsafe-inline'; frame-src ${new URL(url).origin}`;
  return `<!DOCTYPE html>
<meta http-equiv="Content-Security-Policy" content="${policy}">
<title>Karat: Review</title>
<style>html, body, iframe { margin: 0; padding: 0; border: 0; width: 100%; height: 100%; display: block; }</style>
<iframe src="${url}" title="Frames that differ, beside their goldens"></iframe>`;
}

exports.activate = async (context) => {
  const commands = { "karat.test": test, "karat.review": review, "karat.restart": restart };
  for (const [name, run] of Object.entries(commands)) {
    context.subscriptions.push(vscode.commands.registerCommand(name, run));
  }
  const changed = (event) => event.affectsConfiguration("karat") && restart();
  context.subscriptions.push(vscode.workspace.onDidChangeConfiguration(changed));
  await start();
};

async function restart() {
  await stop();
  await start();
}

exports.deactivate = async () => {
  reviews.forEach((server) => server.kill("SIGINT"));
  await stop();
};
