// A layout under the fingers of this screen, set in Unity's inspector. Start `haptix serve` first.
namespace Haptix
{
    using System;
    using System.Collections.Generic;
    using System.IO;
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

    /// <summary>Shows a layout to the service, and reports the fingers of this screen, or the mouse.</summary>
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
        [Tooltip("Arm when the layout is there. Otherwise call Session.Arm when a person asks for it.")]
        public bool arms = true;

        int _run;

        /// <summary>The session; null while there is none.</summary>
        public Session Session { get; private set; }

        /// <summary>A finger entered or left a region, or pressed it.</summary>
        public event Action<Contact> OnContact;

        async void OnEnable()
        {
            int run = ++_run;
            try
            {
                Session session = await Session.Connect(Application.productName);
                if (run != _run)
                {
                    session.Dispose(); // disabled meanwhile
                    return;
                }
                Session = session;
                session.On<Contact>(e => { if (OnContact != null) OnContact(e); });
                session.On<Output>(e => Debug.Log("haptix output " + e.State + ": " + e.Reason, this));
                await Show(session);
                await session.Acquire();
                await session.Intensity(intensity);
                if (arms && run == _run) await session.Arm();
            }
            catch (Exception error)
            {
                if (run != _run) return; // what was asked ended with the session
                Debug.LogException(error, this);
                OnDisable();
            }
        }

        async System.Threading.Tasks.Task Show(Session session)
        {
            double scale = pixelsPerMm > 0.0 ? pixelsPerMm : Screen.dpi / 25.4;
            if (!(scale > 0.0)) throw new InvalidOperationException("Screen.dpi is not known: set pixelsPerMm");
            await session.Geometry(scale, new double[] { originMm.x, originMm.y });
            if (files != "")
                foreach (string path in Directory.GetFiles(Path.Combine(Application.streamingAssetsPath, files)))
                    if (!path.EndsWith(".meta")) await session.Asset(path);
            if (layout != null)
                await session.Ask<LayoutReply>("layout_set", new JObject { { "document", JObject.Parse(layout.text) } });
            foreach (FeltRegion region in regions)
                await session.Layout.Add(Material.Parse(region.material), region.placeMm.x, region.placeMm.y,
                    region.placeMm.width, region.placeMm.height, opacity: region.opacity, name: region.name);
        }

        void Update()
        {
            Session session = Session;
            if (session == null) return;
            session.Pump();
            for (int i = 0; i < Input.touchCount; i++)
            {
                UnityEngine.Touch touch = Input.GetTouch(i);
                bool ends = touch.phase == TouchPhase.Ended || touch.phase == TouchPhase.Canceled;
                TouchKind kind = touch.phase == TouchPhase.Began ? TouchKind.Down : ends ? TouchKind.Up : TouchKind.Move;
                Report(session, touch.fingerId, kind, touch.position);
            }
            if (Input.touchCount > 0) return;
            if (Input.GetMouseButtonDown(0)) Report(session, Mouse, TouchKind.Down, Input.mousePosition);
            else if (Input.GetMouseButtonUp(0)) Report(session, Mouse, TouchKind.Up, Input.mousePosition);
            else if (Input.GetMouseButton(0)) Report(session, Mouse, TouchKind.Move, Input.mousePosition);
        }

        const int Mouse = 255;

        static void Report(Session session, int id, TouchKind kind, Vector2 place)
        {
            // Unity tells no time of a touch: the frame's is the nearest. It counts pixels from below.
            session.Touches(new[] { new TouchReport {
                TimeS = Session.NowS, TouchId = id, Kind = kind, InPixels = true, X = place.x, Y = Screen.height - place.y } });
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
            if (Session != null) Session.Dispose(); // 0 V, and the lease is free
            Session = null;
        }
    }
}
