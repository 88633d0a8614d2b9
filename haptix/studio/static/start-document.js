/** The layout of a bare start: something of each family under the finger. */

/** @type {import("../../../clients/typescript/types/messages.js").LayoutDocument} */
export const START = {
  regions: [
    {
      name: "Ribs", x_mm: 0, y_mm: 0, width_mm: 56, height_mm: 34,
      material: { kind: "grating", period_mm: 2 },
    },
    {
      name: "Sand", x_mm: 60, y_mm: 0, width_mm: 56, height_mm: 34,
      material: { kind: "noise" },
    },
    {
      name: "Slider", x_mm: 0, y_mm: 40, width_mm: 80, height_mm: 16,
      material: { kind: "slider", travel_mm: 80, detents: 9 },
    },
    {
      name: "Button", x_mm: 92, y_mm: 40, width_mm: 24, height_mm: 16,
      material: { kind: "button", width_mm: 24, height_mm: 16 },
    },
  ],
};
