// A layout under the fingers of this screen, set in Unity's inspector. Start `haptix serve` first.
namespace Haptix
{
    using System;
    using System.Collections.Generic;
    using System.IO;
    using System.Linq;
    using System.Threading.Tasks;
    using Haptix.Messages;
    using Newtonsoft.Json.Linq;
    using UnityEngine;

    /// <summary>A region as the inspector shows it.</summary>
    [Serializable]
    public sealed class FeltRegion
    {
        [Tooltip("For events of contact; made where none is given.")]
        public string name = "";
        [Tooltip("JSON, such as `haptix material` saves."), TextArea(2, 10)]
        public string material = "{\"kind\": \"grating\", \"period_mm\": 2}";
        [Tooltip("Millimetres from the screen's upper left corner.")]
        public Rect placeMm = new Rect(0f, 0f, 60f, 60f);
        [Range(0f, 1f)]
        public float opacity = 1f;
    }

    /// <summary>
    /// Shows a layout to the service, and reports the fingers of this screen, or the mouse. Components of
    /// several scenes share one session; it ends with the last of them.
    /// </summary>
    [AddComponentMenu("haptix/Layout under finger"), DisallowMultipleComponent]
    public sealed class LayoutUnderFinger : MonoBehaviour
    {
        [Tooltip("layout.json of the studio's export; may be empty.")]
        public TextAsset layout;
        [Tooltip("Folder in StreamingAssets with the files that the layout names: `assets` of the export.")]
        public string files = "";
        [Tooltip("Regions beside those of the layout.")]
        public List<FeltRegion> regions = new List<FeltRegion>();
        [Tooltip("0: by Screen.dpi.")]
        public double pixelsPerMm;
        [Tooltip("Where the window lies on the screen, mm.")]
        public Vector2 originMm;
        [Range(0f, 1f)]
        public double intensity = 1.0;
        [Tooltip("Arm when the layout is there; after a lost connection only a virtual driver. Otherwise call Session.Arm when a person asks for it.")]
        public bool arms = true;

        static readonly List<LayoutUnderFinger> All = new List<LayoutUnderFinger>(); // that are enabled
        static Task<Session> _shared;

        readonly List<Region> _regions = new List<Region>();
        readonly List<Action> _ends = new List<Action>();
        int _run;

        /// <summary>The session; null while there is none.</summary>
        public Session Session { get; private set; }

        /// <summary>A finger entered or left a region of this component, or pressed it.</summary>
        public event Action<Contact> OnContact;

        async void OnEnable()
        {
            int run = ++_run;
            All.Add(this);
            if (All.Count == 1)
            {
                Fingers.Begin();
                _shared = Session.Connect(Application.productName);
            }
            try
            {
                Session session = await _shared;
                if (run != _run) return; // disabled meanwhile
                Session = session;
                _ends.Add(session.On<Contact>(e => {
                    if (OnContact != null && _regions.Any(region => region.Name == e.Region)) OnContact(e);
                }));
                _ends.Add(session.On<Output>(e => Debug.Log("haptix output " + e.State + ": " + e.Reason, this)));
                _ends.Add(session.On<Warning>(e => Debug.LogWarning("haptix: " + e.Sentence, this)));
                _ends.Add(session.On<Resumed>(e => Resume(session, run, e.Welcome)));
                await Begin(session, run, arms);
            }
            catch (Exception error)
            {
                if (run != _run) return; // what was asked ended with the session
                Debug.LogException(error, this);
                OnDisable();
            }
        }

        async void Resume(Session session, int run, Welcome welcome)
        {
            bool isVirtual = welcome.Inventory.Devices.All(device => !device.IsReal);
            try
            {
                if (!welcome.Lease.IsMine) await Begin(session, run, arms && isVirtual); // another service knows nothing
                else if (arms && isVirtual) await session.Arm();
            }
            catch (Exception error) { if (run == _run) Debug.LogException(error, this); }
        }

        async Task Begin(Session session, int run, bool arm)
        {
            await Show(session);
            await session.Acquire();
            await session.Intensity(intensity);
            if (arm && run == _run) await session.Arm();
        }

        async Task Show(Session session)
        {
            double scale = pixelsPerMm > 0.0 ? pixelsPerMm : Screen.dpi / 25.4;
            if (!(scale > 0.0)) throw new InvalidOperationException("Screen.dpi is not known: set pixelsPerMm");
            await session.Geometry(scale, new double[] { originMm.x, originMm.y });
            if (files != "")
                foreach (string path in Directory.GetFiles(Path.Combine(Application.streamingAssetsPath, files)))
                    if (!path.EndsWith(".meta")) await session.Asset(path);
            _regions.Clear();
            if (layout != null)
                foreach (JObject region in JObject.Parse(layout.text)["regions"])
                {
                    region["op"] = "add";
                    await session.LayoutChange(new object[] { region });
                    _regions.Add(session.Layout.Of((string)region["name"]));
                }
            foreach (FeltRegion region in regions)
                _regions.Add(await session.Layout.Add(Material.Parse(region.material),
                    xMm: region.placeMm.x, yMm: region.placeMm.y, widthMm: region.placeMm.width, heightMm: region.placeMm.height,
                    opacity: region.opacity, name: region.name));
        }

        void Update()
        {
            if (Session == null || All[0] != this) return; // one reports for all
            Session.Pump();
            if (Session != null) Fingers.Report(Session); // a handler may have disabled this
        }

        void OnApplicationFocus(bool hasFocus)
        {
            if (!hasFocus && Session != null) Fingers.Lift(Session);
        }

        /// <summary>0 V, whoever holds the output.</summary>
        [ContextMenu("Stop: 0 V")]
        public void Stop()
        {
            if (Session != null) Session.Stop();
        }

        void OnDisable()
        {
            _run++;
            if (!All.Remove(this)) return;
            foreach (Action end in _ends) end();
            _ends.Clear();
            if (All.Count == 0)
            {
                Fingers.End();
                // 0 V, and the lease is free; at once where there is a session, so that the next scene has it.
                if (Session != null) Session.Dispose();
                else _shared.ContinueWith(opened => opened.Result.Dispose(), TaskContinuationOptions.OnlyOnRanToCompletion);
            }
            else foreach (Region region in _regions)
                region.Remove().ContinueWith(done => done.Exception, TaskContinuationOptions.OnlyOnFaulted);
            _regions.Clear();
            Session = null;
        }
    }
}
