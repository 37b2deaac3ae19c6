import { defineConfig } from "vitest/config";
import karat from "karat-vitest";

export default defineConfig({ plugins: [karat()] });
