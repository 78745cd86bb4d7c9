// Measures what a node's control units keep in MicroPython's heap, a 32-bit port as microcontrollers have:
// node memory.mjs FOLDER_OF_SENSOR_NODE JOB_FILE ANSWER_FILE
// This port collects garbage only between two calls from outside, hence one call a step.
import { writeFileSync } from 'node:fs';
import { loadPort } from './port.mjs';

const [room, job, answer] = process.argv.slice(2);
const port = await loadPort(room, job, { heapsize: 1 << 24 });

function used() {
  port.runPython('gc.collect()');
  port.runPython('used = gc.mem_alloc()');
  return port.globals.get('used');
}

port.runPython('import gc, json, sys; sys.path.append("/")');
const empty = used();
for (const folder of ['firmware', 'firmware/taxel']) {
  const names = port.FS.readdir(`/eskin_sensor_node/${folder}`).filter((name) => !name.startsWith('.'));
  for (const name of names.filter((name) => name !== '__init__.py'))
    port.runPython(`import eskin_sensor_node.${folder.replace('/', '.')}.${name.replace('.py', '')}`);
}
const loaded = used();
port.runPython('from tests.contract.micropython import driver');
port.runPython(`
with open('/job.json') as file:
    job = json.load(file)
clock = driver.Clock(int(job['reading']), job['error'], job['drift'])
writer = driver.MessageWriter(job['boot'], driver.Counter(), bytes.fromhex(job['layout']))
assembler = driver.Assembler(clock, writer)
units = []
given = iter(job['taxels'])
taxels = len(job['taxels'])
steps = [step for step in job['steps'] if 'taxel' in step or 'flush' in step]
count = len(steps)

def work(step):
    return assembler.flush() if 'flush' in step else driver.drive(step, units)
`);
const taxels = [];
let last = used();
for (let k = 0; k < port.globals.get('taxels'); k++) {
  port.runPython('units.append(driver.control_unit(next(given), clock, assembler))');
  const now = used();
  taxels.push(now - last);
  last = now;
}
let records = 0;
let waiting = 0;
for (let k = 0; k < port.globals.get('count'); k++) {
  port.runPython(`said = work(steps[${k}])`);
  const kept = used();
  port.runPython('said = None');
  const rest = used();
  records = Math.max(records, kept - rest);
  waiting = Math.max(waiting, rest - last);
}
port.runPython('assembler.flush()');
const growth = used() - last;
writeFileSync(answer, JSON.stringify({ program: loaded - empty, taxels, growth, records, waiting: waiting - growth }));
