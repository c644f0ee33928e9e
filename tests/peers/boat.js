// Reads NMEA from a local TCP port with Signal K's parser: node boat.js PORT. Prints twenty or more
// magnetic headings of each sentence as JSON, in degrees; exit code 1 at the first line that is not understood.

const net = require('net')
const readline = require('readline')
// scripts/peers installs the package.
const Parser = require(require.resolve('@signalk/nmea0183-signalk', { paths: [process.env.NODE_PEERS] }))

const port = Number(process.argv[2])
const parser = new Parser()
const headingsDeg = { HDM: [], HDG: [] }
const socket = net.connect(port, '127.0.0.1')

function fail (why) {
  console.error(why)
  process.exit(1)
}

readline.createInterface({ input: socket }).on('line', (line) => {
  const kind = line.slice(3, 6)
  // The first line may be incomplete; Signal K ignores proprietary sentences.
  if (!line.startsWith('$HC') || !(kind in headingsDeg)) return
  // The heading field is empty until the module has an attitude.
  if (line.split(',')[1] === '') return
  const delta = parser.parse(line)
  if (!delta) fail(`not understood: ${line}`)
  const values = delta.updates[0].values.filter(({ path }) => path === 'navigation.headingMagnetic')
  if (values.length !== 1) fail(`no magnetic heading: ${line}`)
  headingsDeg[kind].push(values[0].value * 180 / Math.PI)
  if (headingsDeg.HDM.length >= 20 && headingsDeg.HDG.length >= 20) {
    console.log(JSON.stringify(headingsDeg))
    process.exit(0)
  }
})
socket.on('close', () => fail('the module has gone'))
