// MicroPython with nothing but the firmware on its disk, and what the tests drive it with.
import { loadMicroPython } from '@micropython/micropython-webassembly-pyscript/micropython.mjs';
import { readdirSync, readFileSync } from 'node:fs';
import { fileURLToPath } from 'node:url';

// What the firmware must not import is not there.
export async function loadPort(room, job, options = {}) {
  const port = await loadMicroPython({ stdout: console.error, linebuffer: true, ...options });
  function copy(folder) {
    port.FS.mkdir(`/eskin_sensor_node/${folder}`);
    for (const entry of readdirSync(`${room}/${folder}`, { withFileTypes: true })) {
      const name = `${folder}/${entry.name}`;
      if (entry.isDirectory()) copy(name);
      else if (name.endsWith('.py')) port.FS.writeFile(`/eskin_sensor_node/${name}`, readFileSync(`${room}/${name}`));
    }
  }
  port.FS.mkdir('/eskin_sensor_node');
  port.FS.writeFile('/eskin_sensor_node/__init__.py', '');
  copy('firmware');
  const own = fileURLToPath(new URL('.', import.meta.url));
  for (const folder of ['/tests', '/tests/contract', '/tests/contract/micropython']) port.FS.mkdir(folder);
  for (const name of readdirSync(own).filter((name) => name.endsWith('.py'))) {
    port.FS.writeFile(`/tests/contract/micropython/${name}`, readFileSync(`${own}/${name}`));
  }
  port.FS.writeFile('/job.json', readFileSync(job));
  return port;
}
