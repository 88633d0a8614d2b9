// The few names of Unity that the example uses, so that it compiles without Unity.
namespace UnityEngine
{
    public class MonoBehaviour { }
    public struct Vector2 { public float x, y; }
    public enum TouchPhase { Began, Moved, Stationary, Ended, Canceled }

    public struct Touch
    {
        public int fingerId { get; set; }
        public TouchPhase phase { get; set; }
        public Vector2 position { get; set; }
    }

    public static class Input
    {
        public static int touchCount { get { return 0; } }
        public static Touch GetTouch(int index) { return new Touch(); }
    }

    public static class Screen
    {
        public static float dpi { get { return 96f; } }
        public static int height { get { return 1080; } }
    }

    public static class Debug
    {
        public static void Log(object message) { }
    }
}
