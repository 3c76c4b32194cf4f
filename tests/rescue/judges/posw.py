import sys,math,collections
wk={};first={};true={};n=collections.Counter();D=collections.defaultdict(list);Hs=collections.defaultdict(list);prev={}
steps=collections.defaultdict(list)
for fn in sys.argv[1:]:
  for l in open(fn):
    w=l.split(None,5)
    if not w: continue
    if w[0]=='Y': wk[w[1]]='Walker {' in l
    elif w[0]=='P': true[w[1]]=tuple(map(float,l.split()[3:6]))
    elif w[0]=='E' and w[3]=='Log' and 'forget' in l: prev.pop(w[1],None)
    elif w[0]=='E' and w[3]=='Log' and ' B ' in l:
        k=w[1];x=l.split();i=x.index('B');b=tuple(map(float,x[i+1:i+4]));t=true[k]
        if k in prev:
            pb,pt=prev[k]
            # displacement in robot frame at previous search
            def loc(p,q):
                dx,dy=q[0]-p[0],q[1]-p[1];return (math.cos(p[2])*dx+math.sin(p[2])*dy,-math.sin(p[2])*dx+math.cos(p[2])*dy,(q[2]-p[2]+math.pi)%(2*math.pi)-math.pi)
            a,c=loc(pb,b),loc(pt,t)
            steps[wk[k]].append((math.hypot(a[0]-c[0],a[1]-c[1]),abs(math.degrees((a[2]-c[2]+math.pi)%(2*math.pi)-math.pi))))
        prev[k]=(b,t)
for k,v in steps.items():
    e=sorted(x[0] for x in v);h=sorted(x[1] for x in v)
    q=lambda v,f:v[int(len(v)*f)]
    print('walker' if k else 'none',len(v),'step error m p50 %.2f p80 %.2f p90 %.2f p95 %.2f'%tuple(q(e,f) for f in(.5,.8,.9,.95)),'heading p50 %.1f p80 %.1f p90 %.1f p95 %.1f'%tuple(q(h,f) for f in(.5,.8,.9,.95)),'over 20 deg %.3f over 45 %.3f'%(sum(x>20 for x in h)/len(h),sum(x>45 for x in h)/len(h)))
