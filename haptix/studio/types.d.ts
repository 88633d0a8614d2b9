/// <reference path="../../clients/typescript/node_modules/uplot/dist/uPlot.d.ts" />
/** What the pages find in the browser beside its own: uPlot, a classic script. */
